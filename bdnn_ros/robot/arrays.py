"""Arrays of joint values: broadcast to one shape, or read-only."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from bdnn_ros.errors import UsageError


def fitting(width: int, *values: np.ndarray) -> list[np.ndarray]:
    """Values of n joints, broadcast to one shape (..., n).

    Raises:
        UsageError: they do not have n = `width` columns, or cannot be broadcast.
    """
    arrays = [np.asarray(value, float) for value in values]
    shape = arrays[0].shape
    if shape[-1:] == (width,) and all(array.shape == shape for array in arrays):
        return arrays  # the usual case, and fast
    try:
        together = np.broadcast_shapes(*(array.shape for array in arrays))
    except ValueError:
        together = ()
    if together[-1:] != (width,) or any(array.shape[-1:] != (width,) for array in arrays):
        shapes = ", ".join(str(array.shape) for array in arrays)
        raise UsageError(
            f"Values of the shape {shapes} do not fit {width} joints.", f"Give each the shape (..., {width})."
        )
    return [np.broadcast_to(array, together) for array in arrays]


class ReadOnlyArrays:
    """A frozen object that owns its arrays (named in `READ_ONLY`), all read-only, so cached results stay valid."""

    READ_ONLY: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        for name in self.READ_ONLY:
            value = np.asarray(getattr(self, name), float)
            if value.flags.writeable or value.base is not None:
                value = value.copy()
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        self.__post_init__()  # unpickled arrays are writable again
