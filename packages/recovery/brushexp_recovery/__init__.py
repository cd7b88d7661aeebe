"""Strokes are recovered from a photograph of a painting, measured, and judged by truth.

The way of the data, folder by folder; each imports from those before it alone:

- `raster`: arrays of pixels: blur, tiles, label images
- `model`: all that is learned, and the names of its channels and features
- `segment`: a picture -> maps of the network -> superpixels
- `join`: superpixels -> a merge tree -> its best cut
- `find`: a photograph of any size -> the regions of its strokes
- `curves`: regions -> curves with a width
- `order`: regions and curves -> the order of the strokes
- `confidence`: regions -> how sure each of them is
- `recover`: all of these in turn: a picture -> a catalogue of its strokes
- `measure`: strokes -> figures with intervals, tables, files
- `page`: strokes -> a page that shows them on the photograph
- `synthesis`: a seed -> a painting whose strokes are known
- `benchmark`: known strokes and anybody's -> scores and a report
- `train`: paintings whose strokes are known -> a model
- `tasks`: what the command line starts
"""
