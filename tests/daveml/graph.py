"""A second evaluation of a DAVE-ML file, written apart from the importer: recursive, by ElementTree and numpy."""

import math
from functools import cache
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

D = "{http://daveml.org/2010/DAVEML}"
M = "{http://www.w3.org/1998/Math/MathML}"


class Graph:
    """Values of a file's variables by varID, for inputs by varID."""

    def __init__(self, path: Path) -> None:
        root = ElementTree.parse(path).getroot()
        self.variables = {node.get("varID"): node for node in root.iter(f"{D}variableDef")}
        self.functions = {node.find(f"{D}dependentVarRef").get("varID"): node for node in root.iter(f"{D}function")}
        self.tables = {node.get("gtID"): node for node in root.iter(f"{D}griddedTableDef")}
        self.grids = {
            node.get("bpID"): np.array(node.find(f"{D}bpVals").text.replace(",", " ").split(), float)
            for node in root.iter(f"{D}breakpointDef")
        }
        self.read = cache(self._read)
        self.outputs = [name for name, node in self.variables.items() if node.find(f"{D}isOutput") is not None]
        self.inputs = [
            name
            for name, node in self.variables.items()
            if name not in self.functions
            and node.find(f"{D}calculation") is None
            and (node.find(f"{D}isInput") is not None or node.get("initialValue") is None)
        ]

    def evaluate(self, inputs: dict[str, float]) -> dict[str, float]:
        known: dict[str, float] = {}
        return {name: self._value(name, inputs, known) for name in self.outputs}

    def _value(self, name: str, inputs: dict[str, float], known: dict[str, float]) -> float:
        if name not in known:
            node = self.variables[name]
            calculation = node.find(f"{D}calculation")
            if calculation is not None:
                (formula,) = calculation.find(f"{M}math")
                value = self._formula(formula, inputs, known)
            elif name in self.functions:
                value = self._look_up(name, inputs, known)
            else:
                value = inputs[name] if name in self.inputs else float(node.get("initialValue"))
            value = max(value, float(node.get("minValue", "-inf")))
            known[name] = min(value, float(node.get("maxValue", "inf")))
        return known[name]

    def _read(self, name: str) -> tuple[list[np.ndarray], np.ndarray]:
        """Breakpoints and values of the function of a variable."""
        node = self.functions[name]
        definition = node.find(f"{D}functionDefn")
        table = definition.find(f"{D}griddedTableDef")
        if table is None:
            table = self.tables[definition.find(f"{D}griddedTableRef").get("gtID")]
        grids = [self.grids[part.get("bpID")] for part in table.iter(f"{D}bpRef")]
        text = " ".join(table.find(f"{D}dataTable").itertext()).replace(",", " ")
        values = np.array(text.split(), float).reshape([grid.size for grid in grids])
        return grids, values

    def _look_up(self, name: str, inputs, known) -> float:
        grids, values = self.read(name)
        node = self.functions[name]
        nodes = []
        for reference, grid in zip(node.findall(f"{D}independentVarRef"), grids, strict=True):
            assert reference.get("extrapolate") == "neither"
            x = self._value(reference.get("varID"), inputs, known)
            x = float(np.clip(x, float(reference.get("min")), float(reference.get("max"))))
            x = float(np.clip(x, grid[0], grid[-1]))
            right = int(np.clip(np.searchsorted(grid, x), 1, grid.size - 1))
            share = (x - grid[right - 1]) / (grid[right] - grid[right - 1])
            nodes.append(((right - 1, 1.0 - share), (right, share)))
        return sum(
            math.prod(weight for _, weight in corner) * values[tuple(i for i, _ in corner)]
            for corner in product(*nodes)
        )

    def _formula(self, node, inputs, known) -> float:
        kind = node.tag.removeprefix(M)
        if kind == "cn":
            return float(node.text)
        if kind == "ci":
            return self._value(node.text.strip(), inputs, known)
        if kind == "piecewise":
            for piece in node.findall(f"{M}piece"):
                value, condition = piece
                if self._formula(condition, inputs, known):
                    return self._formula(value, inputs, known)
            return self._formula(node.find(f"{M}otherwise")[0], inputs, known)
        head, *rest = node
        operator = head.text.strip() if head.tag == f"{M}csymbol" else head.tag.removeprefix(M)
        if operator == "piecewise":
            return self._formula(head, inputs, known)
        x = [self._formula(part, inputs, known) for part in rest]
        return {
            "plus": lambda: math.fsum(x),
            "minus": lambda: x[0] - x[1] if len(x) == 2 else -x[0],
            "times": lambda: math.prod(x),
            "divide": lambda: x[0] / x[1],
            "power": lambda: math.pow(x[0], x[1]),
            "abs": lambda: math.fabs(x[0]),
            "cos": lambda: math.cos(x[0]),
            "atan2": lambda: math.atan2(x[0], x[1]),
            "gt": lambda: x[0] > x[1],
            "lt": lambda: x[0] < x[1],
        }[operator]()
