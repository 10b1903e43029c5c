import numpy as np

from harness.geometry.outline import hull_distance

POINTS = np.random.default_rng(0).uniform(-1, 1, (500, 3))


def test_the_least_of_all_distances_counts():
    slabs = [lambda p, axis=axis: 0.5 - np.abs(p[:, axis]) for axis in range(3)]
    distance = hull_distance(slabs, POINTS, 10.0)
    np.testing.assert_allclose(distance, 0.5 - np.abs(POINTS).max(axis=1), atol=1e-6)


def test_a_point_far_outside_one_is_not_asked_of_the_next():
    asked = []

    def second(points):
        asked.append(points)
        return np.full(len(points), -9.0)

    distance = hull_distance([lambda p: p[:, 0], second], POINTS, 0.25)
    far = POINTS[:, 0] <= -0.25
    np.testing.assert_allclose(distance[far], POINTS[far, 0], atol=1e-6)
    assert (distance[~far] == -9.0).all()
    np.testing.assert_array_equal(asked[0], POINTS[~far])
