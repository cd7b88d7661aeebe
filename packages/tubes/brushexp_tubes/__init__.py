"""Paintings under what a table has: ``tubes=``, plans to paint after, and how different the painting is to the eye."""
