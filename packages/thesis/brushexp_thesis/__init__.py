"""Rank painters on a leaderboard, test the claims of the thesis by studies, and list departures from its procedure."""
