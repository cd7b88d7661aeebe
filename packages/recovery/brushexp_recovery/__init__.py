"""Recover the strokes of a photographed painting, measure them, and judge methods by paintings with known strokes.

The folders follow the way of the data; each imports only from those before it:

- `raster`: arrays of pixels, their tiles and label images
- `model`: the learned weights, and the names of their channels and features
- `segment`: a picture -> maps of the network -> superpixels
- `join`: superpixels -> a merge tree -> its best cut
- `find`: a photograph of any size -> the regions of its strokes
- `curves`: regions -> curves with a width
- `order`: regions and curves -> the order of the strokes
- `confidence`: regions -> the confidence in each
- `recover`: all of these in turn, a picture -> a catalogue of its strokes
- `measure`: strokes -> figures with intervals, tables, files
- `marks`: marks that people drew -> how far strokes agree with them
- `page`: strokes -> a page that shows them on the photograph
- `synthesis`: a seed -> a painting with known strokes
- `benchmark`: known and predicted strokes -> scores and a report
- `train`: paintings with known strokes -> a model
- `tasks`: what the command line starts
"""
