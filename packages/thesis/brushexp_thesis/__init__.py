"""Rank painters on a leaderboard, judge the claims of the thesis by studies, and list departures from its procedure."""
