"""Further losses, as members of the family ``loss``."""
