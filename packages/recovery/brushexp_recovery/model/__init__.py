"""All that is learned: a network from pictures to maps, perceptrons and logistic models on features of regions.

A file of weights goes in; a `RecoveryModel` comes out. The channels of maps and the columns of features have their
names here, because their order is that of the weights.
"""
