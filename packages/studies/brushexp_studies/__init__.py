"""Compare settings by paired differences, Pareto fronts, curves and effects in sweeps; provide ``task=compare``.

Other packages also use `plotting` and `contact_sheet`.
"""
