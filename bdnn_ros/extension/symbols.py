"""NumPy expressions as ONNX graphs, by arrays that record the operations on them.

A `Symbol` stands for an array whose first axis is a batch of any size. NumPy operations on it are evaluated on an example and
recorded as nodes of a graph, so that formulas are written only once. Only the operations that the models need are supported.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import onnx
from numpy.lib.mixins import NDArrayOperatorsMixin
from onnx import TensorProto, helper, numpy_helper

OPSET = 17
UNARY: dict[Any, str] = {
    np.negative: "Neg",
    np.sin: "Sin",
    np.cos: "Cos",
    np.tanh: "Tanh",
    np.sign: "Sign",
    np.absolute: "Abs",
    np.exp: "Exp",
    np.sqrt: "Sqrt",
    np.log: "Log",
}
BINARY: dict[Any, str] = {
    np.add: "Add",
    np.subtract: "Sub",
    np.multiply: "Mul",
    np.true_divide: "Div",
    np.matmul: "MatMul",
    np.maximum: "Max",
    np.minimum: "Min",
}


class Graph:
    """Nodes and constants of a graph under construction."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: dict[tuple[Any, ...], str] = {}
        self.tensors: list[Any] = []
        self.inputs: list[tuple[str, int]] = []

    def input(self, name: str, example: np.ndarray) -> Symbol:
        """An input (N, n) of the graph."""
        self.inputs.append((name, example.shape[1]))
        return Symbol(self, name, example)

    def constant(self, value: np.ndarray) -> str:
        """The name of a constant."""
        array = np.asarray(value)
        array = array.astype(np.int64 if array.dtype.kind in "iu" else np.float64)
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self.constants:
            self.constants[key] = f"c{len(self.constants)}"
            self.tensors.append(numpy_helper.from_array(array, self.constants[key]))
        return self.constants[key]

    def node(self, kind: str, inputs: Sequence[str], example: np.ndarray, **attributes: Any) -> Symbol:
        """Append a node; returns its output."""
        name = f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return Symbol(self, name, example)

    def model(self, output: Symbol, name: str) -> onnx.ModelProto:
        """The finished model, whose output is called `name`."""
        self.nodes.append(helper.make_node("Identity", [output.name], [name]))

        def described(title: str, width: int) -> Any:
            return helper.make_tensor_value_info(title, TensorProto.DOUBLE, ["N", width])

        graph = helper.make_graph(
            self.nodes,
            "inverse_dynamics",
            [described(*one) for one in self.inputs],
            [described(name, output.shape[1])],
            initializer=self.tensors,
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=9)
        onnx.checker.check_model(model, full_check=True)
        return model


class Symbol(NDArrayOperatorsMixin):
    """An array of a graph, with its value for an example.

    Attributes:
        graph, name: where it is in which graph.
        example: its value for the example inputs, first axis the batch.
    """

    def __init__(self, graph: Graph, name: str, example: np.ndarray) -> None:
        self.graph, self.name, self.example = graph, name, example

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the example."""
        return self.example.shape

    @property
    def ndim(self) -> int:
        """Number of axes, the batch among them."""
        return self.example.ndim

    def __len__(self) -> int:
        return len(self.example)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        out = (options.pop("out", None) or (None,))[0]
        options.pop("casting", None)
        if method != "__call__" or options:
            return NotImplemented
        if ufunc is np.square:
            ufunc, inputs = np.multiply, (inputs[0], inputs[0])
        if ufunc is np.power and inputs[1] == 2:
            ufunc, inputs = np.multiply, (inputs[0], inputs[0])
        kind = UNARY.get(ufunc) or BINARY.get(ufunc)
        if kind is None:
            return NotImplemented
        examples = [x.example if isinstance(x, Symbol) else np.asarray(x, float) for x in inputs]
        made = self.graph.node(kind, [self._named(x) for x in inputs], ufunc(*examples))
        if isinstance(out, Symbol):
            out.name, out.example = made.name, made.example
            return out
        return made

    def __array_function__(self, function: Callable[..., Any], types: Any, args: Any, options: Any) -> Any:
        known = FUNCTIONS.get(function)
        return NotImplemented if known is None else known(self.graph, *args, **options)

    def _named(self, value: Any) -> str:
        return value.name if isinstance(value, Symbol) else self.graph.constant(np.asarray(value, float))

    def __getitem__(self, key: Any) -> Symbol:
        """Basic indexing, and one list of indices; the batch axis only as a whole."""
        key = key if isinstance(key, tuple) else (key,)
        missing = self.ndim - sum(k is not None and k is not Ellipsis for k in key)
        if Ellipsis in [k for k in key if not isinstance(k, np.ndarray)]:
            at = next(i for i, k in enumerate(key) if k is Ellipsis)
            key = (*key[:at], *(slice(None),) * missing, *key[at + 1 :])
        result, axis = self, 0
        for one in key:
            if one is None:
                result = result.expanded(axis)
                axis += 1
                continue
            if isinstance(one, slice):
                if one != slice(None):
                    result = result.taken(np.arange(result.shape[axis])[one], axis)
                axis += 1
            elif np.ndim(one) == 0:
                result = result.taken(np.asarray(one), axis)
            else:
                result, axis = result.taken(np.asarray(one), axis), axis + 1
        return result

    def __setitem__(self, key: Any, value: Any) -> None:
        """Replace a slice of the second axis."""
        if not (isinstance(key, tuple) and len(key) == 2 and key[0] == slice(None) and key[1].step is None):
            raise TypeError("only a slice of the second axis can be replaced")
        start, stop, _ = key[1].indices(self.shape[1])
        parts = [self[:, :start], value, self[:, stop:]]
        new = _concatenate(self.graph, [part for part in parts if part.shape[1]], 1)
        self.name, self.example = new.name, new.example

    def taken(self, index: np.ndarray, axis: int) -> Symbol:
        """Entries along an axis; a single index removes the axis."""
        if axis == 0:
            raise TypeError("the batch is taken whole")
        example = np.take(self.example, index, axis)
        return self.graph.node("Gather", [self.name, self.graph.constant(index)], example, axis=axis)

    def expanded(self, axis: int) -> Symbol:
        """The array with a new axis of length one."""
        example = np.expand_dims(self.example, axis)
        return self.graph.node("Unsqueeze", [self.name, self.graph.constant(np.array([axis]))], example)

    def reshape(self, *shape: Any) -> Symbol:
        """The same entries in another shape, the batch first."""
        sizes = shape[0] if len(shape) == 1 and isinstance(shape[0], (tuple, list)) else shape
        example: np.ndarray = np.reshape(self.example, sizes)
        if len(example) != len(self):
            raise TypeError("the batch keeps its axis")
        target = self.graph.constant(np.array([-1, *np.shape(example)[1:]]))
        return self.graph.node("Reshape", [self.name, target], example)

    def sum(self, axis: int) -> Symbol:
        """Sum along an axis, which is removed."""
        axis = axis % self.ndim
        names = [self.name, self.graph.constant(np.array([axis]))]
        return self.graph.node("ReduceSum", names, self.example.sum(axis), keepdims=0)


def _concatenate(graph: Graph, parts: Sequence[Any], axis: int = 0) -> Symbol:
    length = next(len(p) for p in parts if isinstance(p, Symbol))
    axis = axis % np.ndim(next(p.example for p in parts if isinstance(p, Symbol)))
    examples = [p.example if isinstance(p, Symbol) else np.asarray(p, float) for p in parts]
    if any(len(example) != length for example in examples):
        raise TypeError("the batch keeps its axis")
    names = [p.name if isinstance(p, Symbol) else graph.constant(np.asarray(p, float)) for p in parts]
    return graph.node("Concat", names, np.concatenate(examples, axis), axis=axis)


def _stack(graph: Graph, parts: Sequence[Symbol], axis: int = 0) -> Symbol:
    place = axis % (parts[0].ndim + 1)
    return _concatenate(graph, [part.expanded(place) for part in parts], place)


def _einsum(graph: Graph, equation: str, *operands: Any) -> Symbol:
    examples = [x.example if isinstance(x, Symbol) else np.asarray(x, float) for x in operands]
    names = [x.name if isinstance(x, Symbol) else graph.constant(np.asarray(x, float)) for x in operands]
    return graph.node("Einsum", names, np.einsum(equation, *examples), equation=equation)


def _filled(value: float) -> Callable[..., Symbol]:
    def like(graph: Graph, symbol: Symbol, **_: object) -> Symbol:
        return symbol * 0.0 + value

    return like


def _swapaxes(graph: Graph, symbol: Symbol, first: int, second: int) -> Symbol:
    order = list(range(symbol.ndim))
    first, second = first % symbol.ndim, second % symbol.ndim
    order[first], order[second] = second, first
    return graph.node("Transpose", [symbol.name], np.transpose(symbol.example, order), perm=order)


FUNCTIONS: dict[Callable[..., Any], Callable[..., Any]] = {
    np.concatenate: _concatenate,
    np.stack: _stack,
    np.einsum: _einsum,
    np.swapaxes: _swapaxes,
    np.zeros_like: _filled(0.0),
    np.ones_like: _filled(1.0),
    np.sum: lambda graph, symbol, axis: symbol.sum(axis),
    np.reshape: lambda graph, symbol, shape: symbol.reshape(shape),
    np.shape: lambda graph, symbol: symbol.shape,
    np.ndim: lambda graph, symbol: symbol.ndim,
}
