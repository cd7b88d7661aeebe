"""A leaderboard of painters, the claims of the thesis judged by studies, and departures from its procedure."""
