"""Converts the two TFLite face graphs to ONNX, for OpenCV builds without FlatBuffers.

Only the operators these graphs use are known: Conv, DepthwiseConv, PRelu, Relu, Add, MaxPool, Pad,
Reshape, Concatenation and the dequantisation of 16-bit float weights. TFLite keeps images as NHWC;
here everything runs as NCHW and only a Reshape goes back to NHWC first, so that the order of the
numbers stays that of the original. TFLite's SAME padding is one-sided for stride 2: it becomes a
Pad node of its own, since OpenCV's convolution accepts symmetric padding only.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

OPSET = 11
_DTYPES = {0: np.float32, 1: np.float16, 2: np.int32, 4: np.int64}
_RELU = 1
_SAME = 0


def convert(data: bytes) -> bytes:
    """The ONNX model of a TFLite model; input (1, 3, h, w) float32.

    Raises `ValueError` for an operator that is not known here.
    """
    import tflite

    return _Converter(tflite.Model.GetRootAsModel(data, 0)).run()


class _Converter:
    def __init__(self, model: Any) -> None:
        import onnx
        import tflite

        self.tflite = tflite
        self.helper = onnx.helper
        self.numpy_helper = onnx.numpy_helper
        self.float = onnx.TensorProto.FLOAT
        self.model = model
        self.graph = model.Subgraphs(0)
        self.nodes: list[Any] = []
        self.constants: dict[str, NDArray[Any]] = {}
        self.values: dict[int, NDArray[Any]] = {}
        names = vars(tflite.BuiltinOperator).items()
        self.operator_names = {code: name for name, code in names if isinstance(code, int)}

    def run(self) -> bytes:
        for index in range(self.graph.OperatorsLength()):
            operator = self.graph.Operators(index)
            handler = getattr(self, "_" + self._kind(operator).lower(), None)
            if handler is None:
                raise ValueError(f"unknown TFLite operator {self._kind(operator)}")
            handler(operator)
        graph = self.helper.make_graph(
            self.nodes,
            "face",
            [self._declare(self.graph.Inputs(0))],
            [self._declare(int(index)) for index in self.graph.OutputsAsNumpy()],
            [self.numpy_helper.from_array(value, name) for name, value in self.constants.items()],
        )
        model = self.helper.make_model(
            graph,
            producer_name="hypermask",
            opset_imports=[self.helper.make_opsetid("", OPSET)],
            ir_version=7,
        )
        return bytes(model.SerializeToString())

    # -- tensors

    def _kind(self, operator: Any) -> str:
        code = self.model.OperatorCodes(operator.OpcodeIndex())
        return str(self.operator_names[max(code.BuiltinCode(), code.DeprecatedBuiltinCode())])

    def _shape(self, index: int) -> list[int]:
        return [int(size) for size in self.graph.Tensors(index).ShapeAsNumpy()]

    def _name(self, index: int) -> str:
        """The file's own name for inputs and outputs, a numbered one inside."""
        index = int(index)
        if index in self.graph.OutputsAsNumpy() or index in self.graph.InputsAsNumpy():
            return str(self.graph.Tensors(index).Name().decode())
        return f"t{index}"

    def _declare(self, index: int) -> Any:
        shape = self._shape(index)
        if len(shape) == 4:
            shape = [shape[0], shape[3], shape[1], shape[2]]
        return self.helper.make_tensor_value_info(self._name(index), self.float, shape)

    def _value(self, index: int) -> NDArray[Any]:
        """A constant of the graph, dequantised, in TFLite's own layout."""
        index = int(index)
        if index in self.values:
            return self.values[index]
        tensor = self.graph.Tensors(index)
        raw = self.model.Buffers(tensor.Buffer()).DataAsNumpy()
        return np.frombuffer(raw.tobytes(), _DTYPES[tensor.Type()]).reshape(self._shape(index))

    def _constant(self, name: str, value: NDArray[Any]) -> str:
        self.constants[name] = np.ascontiguousarray(value)
        return name

    def _add_node(self, kind: str, inputs: list[str], output: str, **attributes: Any) -> None:
        self.nodes.append(self.helper.make_node(kind, inputs, [output], output, **attributes))

    def _options(self, operator: Any, kind: Any) -> Any:
        table = operator.BuiltinOptions()
        options = kind()
        options.Init(table.Bytes, table.Pos)
        return options

    def _activated(self, activation: int, output: str) -> tuple[str, str | None]:
        """The name to compute into, and the final name where an activation follows."""
        if activation == 0:
            return output, None
        if activation != _RELU:
            raise ValueError(f"unknown fused activation {activation}")
        return output + "_linear", output

    def _finish(self, computed: str, final: str | None) -> None:
        if final is not None:
            self._add_node("Relu", [computed], final)

    # -- operators

    def _dequantize(self, operator: Any) -> None:
        source, target = int(operator.Inputs(0)), int(operator.Outputs(0))
        self.values[target] = self._value(source).astype(np.float32)

    def _conv_2d(self, operator: Any) -> None:
        options = self._options(operator, self.tflite.Conv2DOptions)
        weights = self._value(operator.Inputs(1)).transpose(0, 3, 1, 2)
        self._convolution(operator, options, weights, 1)

    def _depthwise_conv_2d(self, operator: Any) -> None:
        options = self._options(operator, self.tflite.DepthwiseConv2DOptions)
        weights = self._value(operator.Inputs(1)).transpose(3, 0, 1, 2)
        self._convolution(operator, options, weights, weights.shape[0])

    def _convolution(self, operator: Any, options: Any, weights: NDArray[Any], groups: int) -> None:
        output = self._name(operator.Outputs(0))
        kernel = [int(size) for size in weights.shape[2:]]
        strides = [options.StrideH(), options.StrideW()]
        source, pads = self._padded(operator, kernel, strides, options.Padding(), 0.0)
        computed, final = self._activated(options.FusedActivationFunction(), output)
        self._add_node(
            "Conv",
            [
                source,
                self._constant(output + "_w", weights.astype(np.float32)),
                self._constant(output + "_b", self._value(operator.Inputs(2))),
            ],
            computed,
            kernel_shape=kernel,
            strides=strides,
            pads=pads,
            group=groups,
        )
        self._finish(computed, final)

    def _padded(
        self, operator: Any, kernel: list[int], strides: list[int], padding: int, value: float
    ) -> tuple[str, list[int]]:
        """(input's name, symmetric pads); one-sided padding is put into a node of its own."""
        source = int(operator.Inputs(0))
        if padding != _SAME:
            return self._name(source), [0, 0, 0, 0]
        size = self._shape(source)[1:3]
        total = [
            max((-(-n // s) - 1) * s + k - n, 0)
            for n, k, s in zip(size, kernel, strides, strict=True)
        ]
        begin = [t // 2 for t in total]
        end = [t - b for t, b in zip(total, begin, strict=True)]
        if begin == end:
            return self._name(source), begin + end
        name = f"{self._name(operator.Outputs(0))}_padded"
        self._pad_node(self._name(source), name, [0, 0, *begin, 0, 0, *end], value)
        return name, [0, 0, 0, 0]

    def _pad_node(self, source: str, output: str, pads: list[int], value: float = 0.0) -> None:
        names = [
            source,
            self._constant(output + "_pads", np.array(pads, np.int64)),
            self._constant(output + "_value", np.array(value, np.float32)),
        ]
        self._add_node("Pad", names, output, mode="constant")

    def _max_pool_2d(self, operator: Any) -> None:
        options = self._options(operator, self.tflite.Pool2DOptions)
        kernel = [options.FilterHeight(), options.FilterWidth()]
        strides = [options.StrideH(), options.StrideW()]
        source, pads = self._padded(operator, kernel, strides, options.Padding(), -1e30)
        computed, final = self._activated(
            options.FusedActivationFunction(), self._name(operator.Outputs(0))
        )
        self._add_node(
            "MaxPool", [source], computed, kernel_shape=kernel, strides=strides, pads=pads
        )
        self._finish(computed, final)

    def _pad(self, operator: Any) -> None:
        before, after = self._value(operator.Inputs(1))[[0, 3, 1, 2]].T.tolist()
        self._pad_node(
            self._name(operator.Inputs(0)), self._name(operator.Outputs(0)), before + after
        )

    def _prelu(self, operator: Any) -> None:
        output = self._name(operator.Outputs(0))
        slope = self._value(operator.Inputs(1)).reshape(-1, 1, 1).astype(np.float32)
        names = [self._name(operator.Inputs(0)), self._constant(output + "_slope", slope)]
        self._add_node("PRelu", names, output)

    def _relu(self, operator: Any) -> None:
        self._add_node("Relu", [self._name(operator.Inputs(0))], self._name(operator.Outputs(0)))

    def _add(self, operator: Any) -> None:
        options = self._options(operator, self.tflite.AddOptions)
        computed, final = self._activated(
            options.FusedActivationFunction(), self._name(operator.Outputs(0))
        )
        inputs = [self._name(operator.Inputs(i)) for i in range(2)]
        self._add_node("Add", inputs, computed)
        self._finish(computed, final)

    def _reshape(self, operator: Any) -> None:
        source, output = int(operator.Inputs(0)), int(operator.Outputs(0))
        name = self._name(output)
        self._add_node("Transpose", [self._name(source)], name + "_nhwc", perm=[0, 2, 3, 1])
        shape = self._constant(name + "_shape", np.array(self._shape(output), np.int64))
        self._add_node("Reshape", [name + "_nhwc", shape], name)

    def _concatenation(self, operator: Any) -> None:
        inputs = [self._name(operator.Inputs(i)) for i in range(operator.InputsLength())]
        self._add_node("Concat", inputs, self._name(operator.Outputs(0)), axis=1)
