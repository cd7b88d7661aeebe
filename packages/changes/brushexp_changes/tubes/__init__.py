"""Paint with what a table has: ``tubes=``, plans to paint after, and how different a painting is to the eye."""
