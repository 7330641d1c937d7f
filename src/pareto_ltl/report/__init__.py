"""Pictures of a run. Only this room knows matplotlib; import it inside the stage that draws."""
