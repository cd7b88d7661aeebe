"""Tables and plots, whatever they show."""
