"""Write any data as tables in several formats."""
