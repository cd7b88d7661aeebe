"""Measure a picture's brushwork with intervals derived from several paintings, and calibrate the intervals."""
