"""Measure a picture's brushwork with intervals from several paintings of it, and calibrate the intervals."""
