"""Write simulated strokes as shards, and read them as batches."""
