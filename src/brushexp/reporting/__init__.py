"""General tables in several formats."""
