"""Independent evaluation of a DAVE-ML file, to compare the importer with.

It is recursive and uses ElementTree and scipy.
"""

import math
from xml.etree import ElementTree

import numpy as np
from scipy.interpolate import RegularGridInterpolator


class Graph:
    """Values of a file's variables by varID, for inputs by varID."""

    def __init__(self, path):
        root = ElementTree.parse(path).getroot()
        for node in root.iter():
            node.tag = node.tag.rpartition("}")[2]  # the name without its name space
        self.variables = {node.get("varID"): node for node in root.iter("variableDef")}
        self.functions = {
            node.find("dependentVarRef").get("varID"): node for node in root.iter("function")
        }
        self.outputs = [
            name for name, node in self.variables.items() if node.find("isOutput") is not None
        ]
        self.inputs = [
            name
            for name, node in self.variables.items()
            if name not in self.functions
            and node.find("calculation") is None
            and (node.find("isInput") is not None or node.get("initialValue") is None)
        ]
        grids = {
            node.get("bpID"): _numbers(node.find("bpVals")) for node in root.iter("breakpointDef")
        }
        shared = {node.get("gtID"): node for node in root.iter("griddedTableDef")}
        self.tables = {}
        for name, node in self.functions.items():
            table = node.find("functionDefn/griddedTableDef")
            if table is None:  # of DAVE-ML 1
                table = node.find("functionDefn/griddedTable")
            if table is None:
                table = shared[node.find("functionDefn/griddedTableRef").get("gtID")]
            axes = [grids[reference.get("bpID")] for reference in table.iter("bpRef")]
            values = _numbers(table.find("dataTable")).reshape([axis.size for axis in axes])
            self.tables[name] = RegularGridInterpolator(axes, values)

    def evaluate(self, inputs):
        computed: dict[str, float] = {}
        return {name: self._value(name, inputs, computed) for name in self.outputs}

    def _value(self, name, inputs, computed):
        if name not in computed:
            node = self.variables[name]
            calculation = node.find("calculation")
            if calculation is not None:
                (formula,) = calculation.find("math")
                value = self._formula(formula, inputs, computed)
            elif name in self.functions:
                value = self._look_up(name, inputs, computed)
            else:
                value = inputs[name] if name in self.inputs else float(node.get("initialValue"))
            value = max(value, float(node.get("minValue", "-inf")))
            computed[name] = min(value, float(node.get("maxValue", "inf")))
        return computed[name]

    def _look_up(self, name, inputs, computed):
        table, point = self.tables[name], []
        for reference, axis in zip(
            self.functions[name].findall("independentVarRef"), table.grid, strict=True
        ):
            assert reference.get("extrapolate", "neither") == "neither"  # the default
            x = self._value(reference.get("varID"), inputs, computed)
            x = np.clip(
                x, float(reference.get("min", axis[0])), float(reference.get("max", axis[-1]))
            )
            point.append(np.clip(x, axis[0], axis[-1]))
        return float(table(point)[0])

    def _formula(self, node, inputs, computed):
        if node.tag == "cn":
            return float(node.text)
        if node.tag == "ci":
            return self._value(node.text.strip(), inputs, computed)
        if node.tag == "piecewise":
            for value, condition in node.findall("piece"):
                if self._formula(condition, inputs, computed):
                    return self._formula(value, inputs, computed)
            return self._formula(node.find("otherwise")[0], inputs, computed)
        head, *operands = node
        operator = head.text.strip() if head.tag == "csymbol" else head.tag
        if operator == "piecewise":
            return self._formula(head, inputs, computed)
        x = [self._formula(operand, inputs, computed) for operand in operands]
        return {
            "plus": lambda: math.fsum(x),
            "minus": lambda: x[0] - x[1] if len(x) == 2 else -x[0],
            "times": lambda: math.prod(x),
            "divide": lambda: x[0] / x[1],
            "power": lambda: math.pow(x[0], x[1]),
            "abs": lambda: math.fabs(x[0]),
            "cos": lambda: math.cos(x[0]),
            "exp": lambda: math.exp(x[0]),
            "atan2": lambda: math.atan2(x[0], x[1]),
            "gt": lambda: x[0] > x[1],
            "lt": lambda: x[0] < x[1],
        }[operator]()


def _numbers(node):
    return np.array("".join(node.itertext()).replace(",", " ").split(), float)
