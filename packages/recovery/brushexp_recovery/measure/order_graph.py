"""Write the order of strokes as a GraphML graph with probabilities, for Gephi, networkx and igraph (Brandes, 2002)."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from brushexp.contracts.files import write_bytes
from brushexp_recovery.measure.stroke_table import StrokeTable

NAMESPACE = "http://graphml.graphdrawing.org/xmlns"
OF_NODES = ("order", "confidence", "x", "y", "length", "width", "direction")  # columns of the table, in pixels
OF_EDGES = ("chance",)


def write_order_graph(path: Path, strokes: StrokeTable, recovered: Any) -> None:
    """Write each stroke as a node, and each pair of touching strokes as an edge from the lower to the upper one.

    The name of a node is the stroke's number in the catalogue. Each edge has the probability of its direction, which is
    between 0.5 and 1 because edges point in the more likely direction.
    """
    root = ElementTree.Element("graphml", {"xmlns": NAMESPACE})
    for kind, names in (("node", OF_NODES), ("edge", OF_EDGES)):
        for name in names:
            attributes = {"id": name, "for": kind, "attr.name": name, "attr.type": "double"}
            ElementTree.SubElement(root, "key", attributes)
    graph = ElementTree.SubElement(root, "graph", {"id": "order", "edgedefault": "directed"})
    for row, number in enumerate(strokes.columns["stroke"].tolist()):
        node = ElementTree.SubElement(graph, "node", {"id": str(number)})
        for name in OF_NODES:
            ElementTree.SubElement(node, "data", {"key": name}).text = f"{strokes.columns[name][row]:.6g}"
    above = np.asarray(recovered.chance_above, float)
    for (first, second), chance in zip(recovered.meetings.tolist(), above.tolist(), strict=True):
        lower, upper = (first, second) if chance >= 0.5 else (second, first)
        edge = ElementTree.SubElement(graph, "edge", {"source": str(lower), "target": str(upper)})
        ElementTree.SubElement(edge, "data", {"key": "chance"}).text = f"{max(chance, 1 - chance):.4f}"
    ElementTree.indent(root)
    write_bytes(path, ElementTree.tostring(root, "utf-8", xml_declaration=True))
