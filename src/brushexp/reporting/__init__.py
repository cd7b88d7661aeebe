"""Tables in several formats, for any data."""
