"""Define the learned models: a network that predicts maps, and perceptrons and logistic models on region features.

A `RecoveryModel` is loaded from a weights file. The channels of maps and the columns of features are named here,
because the weights depend on their order.
"""
