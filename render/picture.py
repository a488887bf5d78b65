"""A picture that is filled part by part: samples averaged over their pixels, layer by layer."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from coslobe.render.scene import Image
from coslobe.render.visible import Visible


class Picture:
    """Layers of one frame.

    Attributes
    ----------
    layers : dict
        By name, float32 [h, w] or [h, w, 3].
    points : int
        Shaded points so far.
    """

    def __init__(self, image: Image) -> None:
        self._image = image
        self.layers: dict[str, NDArray[np.float32]] = {}
        self.points = 0

    def add(self, visible: Visible, averaged: Mapping[str, NDArray], first: Mapping[str, NDArray]) -> None:
        """Fill in the pixels of `visible` with values at its points, [n] or [n, 3].

        Those in `averaged` are averaged over each pixel's samples (box filter, background 0); of those in
        `first` the first sample that hits something is taken (background 0, of "object" -1), because averages
        of indices or normals would mean nothing.
        """
        self.points += len(visible)
        pixel = visible.hits.rays.pixel[:: self._image.samples]
        for name, values in averaged.items():
            samples = self._samples(visible, values, 0.0)
            self._put(name, pixel, samples[:, 0] if samples.shape[1] == 1 else samples.mean(axis=1))
        if first:
            hit = (visible.hits.object >= 0).reshape(len(pixel), -1)
            sample = hit.argmax(axis=1)
            for name, values in first.items():
                background = -1.0 if name == "object" else 0.0
                samples = self._samples(visible, values, background)
                self._put(name, pixel, samples[np.arange(len(pixel)), sample])

    def _samples(self, visible: Visible, values: NDArray, background: float) -> NDArray:
        """Values of all samples, float32 [pixels, samples] or [pixels, samples, 3]."""
        every = np.asarray(values, np.float32)
        if not visible.complete:
            every = np.full((len(visible.hits.object), *values.shape[1:]), background, np.float32)
            every[visible.ray] = values
        return every.reshape(-1, self._image.samples, *values.shape[1:])

    def _put(self, name: str, pixel: NDArray, values: NDArray) -> None:
        """Fill in pixels of a layer, float32 [n] or [n, 3]; it is made where there is none."""
        if name not in self.layers:
            shape = (self._image.height, self._image.width, *values.shape[1:])
            self.layers[name] = np.zeros(shape, np.float32)
        whole_pixels(self.layers[name], self._image.height * self._image.width)[pixel] = whole_pixels(
            np.ascontiguousarray(values), len(pixel)
        )


def whole_pixels(array: NDArray, n: int) -> NDArray:
    """A view of n pixels, each as one item: NumPy moves those twice as fast as rows of numbers."""
    rows = array.reshape(n, -1)
    return rows.view(np.dtype((np.void, rows.itemsize * rows.shape[1])))[:, 0]
