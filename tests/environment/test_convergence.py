from __future__ import annotations

from rauca_core.training.extractor import converged_epoch, smoothed


def test_smoothing_is_the_papers():
    assert smoothed([1.0, 0.5, 0.0]) == [1.0, 0.75, 0.25]


def test_a_flat_curve_converges_at_the_fifth_epoch_and_no_sooner():
    assert converged_epoch([0.05] * 5) is None
    assert converged_epoch([0.05] * 6) == 5


def test_all_five_epochs_before_must_be_near():
    errors = [0.2, 0.1, 0.06, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05]
    assert converged_epoch(errors) == 9  # MS_4 ... MS_9 are 0.05; MS_3 is 0.055
    assert converged_epoch(errors[:9]) is None
    assert converged_epoch([1.0 - 0.002 * i for i in range(50)]) is None
    assert converged_epoch([1.0 - 0.0005 * i for i in range(50)]) is not None
