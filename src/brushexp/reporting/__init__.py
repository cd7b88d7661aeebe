"""Tables, whatever they show."""
