"""Rank painters on a leaderboard, test the thesis's claims in studies, and list departures from its procedure."""
