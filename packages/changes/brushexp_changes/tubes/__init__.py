"""Paint with the tubes and brushes on a table: ``tubes=``, plans to paint from, and a perceptual colour difference."""
