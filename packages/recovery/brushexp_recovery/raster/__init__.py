"""Pictures, label images and maps as arrays: blurred, resampled, split into tiles, compared, stored.

Arrays go in and come out; nothing here knows of strokes.
"""
