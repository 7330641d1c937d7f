"""What people do with a plan: files, figures and pages, the flight, studies, the desk, the command line."""
