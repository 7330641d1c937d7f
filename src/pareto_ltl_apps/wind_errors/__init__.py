"""Laws of wind errors, estimated from the files of users and checked on others."""
