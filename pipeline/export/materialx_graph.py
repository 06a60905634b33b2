"""Building a MaterialX node graph by arithmetic: a thin hand over the library's nodes."""

from __future__ import annotations

from typing import Any

Value = Any


class Graph:
    """Nodes of one graph, named in the order they are made.

    Parameters
    ----------
    graph
        A MaterialX NodeGraph.
    """

    def __init__(self, graph: Any) -> None:
        self.graph = graph

    def node(self, category: str, kind: str = "float", **inputs: Value) -> Any:
        """Add a node; an input is another node, or a value with its type, or a number."""
        node = self.graph.addNode(category, f"{category}_{len(self.graph.getNodes())}", kind)
        for name, value in inputs.items():
            if hasattr(value, "getCategory"):
                node.addInput(name, value.getType()).setNodeName(value.getName())
            elif isinstance(value, tuple):
                given, its_kind = value
                node.addInput(name, its_kind).setValueString(given)
            else:
                node.addInput(name, "float").setValueString(f"{float(value):.9g}")
        return node

    def add(self, a: Value, b: Value) -> Any:
        """Sum."""
        return self.node("add", in1=a, in2=b)

    def subtract(self, a: Value, b: Value) -> Any:
        """Difference."""
        return self.node("subtract", in1=a, in2=b)

    def multiply(self, a: Value, b: Value) -> Any:
        """Product."""
        return self.node("multiply", in1=a, in2=b)

    def divide(self, a: Value, b: Value) -> Any:
        """Quotient."""
        return self.node("divide", in1=a, in2=b)

    def clamp(self, a: Value, low: Value, high: Value) -> Any:
        """Limit a number."""
        return self.node("clamp", **{"in": a, "low": low, "high": high})

    def floor(self, a: Value) -> Any:
        """Next lower whole number."""
        return self.node("floor", **{"in": a})

    def modulo(self, a: Value, b: Value) -> Any:
        """What remains, 0 to b, of a over b; for negative a too."""
        return self.node("modulo", in1=a, in2=b)

    def maximum(self, a: Value, b: Value) -> Any:
        """The larger."""
        return self.node("max", in1=a, in2=b)

    def where(self, a: Value, above: Value, then: Value, otherwise: Value) -> Any:
        """`then` where a > above."""
        return self.node("ifgreater", value1=a, value2=above, in1=then, in2=otherwise)

    def mix(self, low: Value, high: Value, part: Value) -> Any:
        """Linear between two."""
        return self.node("mix", bg=low, fg=high, mix=part)

    def image(self, file: str, kind: str, u: Any, v: Any) -> Any:
        """Bilinear look-up; u and v are 0..1, v up."""
        place = self.node("combine2", "vector2", in1=u, in2=v)
        node = self.node("image", kind, texcoord=place)
        node.addInput("file", "filename").setValueString(file)
        for name in ("uaddressmode", "vaddressmode"):
            node.addInput(name, "string").setValueString("clamp")
        node.addInput("filtertype", "string").setValueString("linear")
        return node
