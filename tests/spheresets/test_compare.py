"""Which of two sphere sets is said to be better."""

import numpy as np

from coslobe.spheresets.compare import measure_all, side_by_side
from coslobe.spheresets.model import SphereSet


def test_each_metric_has_its_own_better():
    a = {"volume_iou": 0.9, "max_gap": 0.2, "shadow_bias": [-0.1, 0.3, 0.2]}
    b = {"volume_iou": 0.8, "max_gap": 0.1, "shadow_bias": [0.2, -0.2, 0.2]}
    rows = side_by_side([a, b])
    assert [(row.name, row.better) for row in rows] == [
        ("volume_iou", 0),
        ("max_gap", 1),
        ("shadow_bias (light 0.05)", 0),
        ("shadow_bias (light 0.3)", 1),
        ("shadow_bias (light 0.8)", None),  # equal
    ]
    assert rows[2].values == (-0.1, 0.2)


def test_the_ball_itself_beats_a_smaller_one(ball, one_device, monkeypatch):
    monkeypatch.setattr("coslobe.spheresets.ground_shadow.GROUND_CELLS", 24)
    sets = [SphereSet(np.zeros((1, 3)), np.full(1, radius), np.zeros(1)) for radius in (0.8, 1.0)]
    rows = {row.name: row for row in side_by_side(measure_all(ball, sets, one_device))}
    assert rows["silhouette_iou_mean"].better == 1
    assert rows["max_gap"].better == 1
    assert rows["outside_volume"].better == 0  # the smaller one lies inside
