"""Recover the strokes in a photographed painting, measure them, and evaluate methods on paintings with known strokes.

The folders are listed in the order of data flow; each folder imports only from earlier ones:

- `raster`: arrays of pixels, their tiles and label images
- `model`: the learned weights, and the names of the channels and features that they use
- `segment`: a picture -> maps predicted by the network -> superpixels
- `join`: superpixels -> a merge tree -> its best cut
- `find`: a photograph of any size -> the regions of its strokes
- `curves`: regions -> curves with a width
- `order`: regions and curves -> the painting order of strokes
- `confidence`: regions -> the confidence in each region
- `recover`: the whole pipeline, a picture -> a catalogue of its strokes
- `measure`: strokes -> figures with intervals, tables, files
- `marks`: marks drawn by people -> their agreement with strokes
- `page`: strokes -> a page that shows them on the photograph
- `synthesis`: a seed -> a painting with known strokes
- `benchmark`: known and predicted strokes -> scores and a report
- `train`: paintings with known strokes -> a model
- `tasks`: the command-line tasks of the package
"""
