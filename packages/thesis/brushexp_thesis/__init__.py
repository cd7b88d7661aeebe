"""The authors' own paper: painters compared, the thesis's claims judged by studies."""
