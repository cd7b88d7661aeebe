"""The moving average of the weights of a training."""

from brushexp_training.network_fitting import MovingAverage
from test_callbacks import Line, fit


def test_the_average_lags_behind_and_is_left_in_place(tmp_path):
    plain, averaged = Line(), Line()
    fit(tmp_path, plain)
    fit(tmp_path, averaged, callbacks=[MovingAverage(0.9)])
    assert 0 < averaged.weight.item() < plain.weight.item()
