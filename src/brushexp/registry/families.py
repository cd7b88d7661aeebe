"""List the families of plugins: everything that a user may want to vary."""

FAMILIES = {
    "painter": "target picture -> strokes, state after state",
    "palette": "colours of the picture -> colours of the painting",
    "init": "target picture -> first strokes",
    "renderer": "stroke parameters -> what each stroke covers",
    "blend": "strokes in depth order -> picture",
    "color": "the space in which paint is composited",
    "paper": "what the paint lies on: which of it stays bare, and its relief",
    "order": "strokes -> depth",
    "loss": "painting -> number to minimise",
    "metric": "finished painting -> number that says how good it is",
    "density": "when strokes are added and removed",
    "sampler": "which part of the canvas a step looks at",
    "optimizer": "how strokes move",
    "change": "what is different about this painting",
    "engine": "brush simulators: stroke parameters -> picture of one stroke",
    "callbacks": "what happens beside the steps of a fit",
    "logger": "where the curves of a run go",
    "to": "finished painting -> files that other programs read",
}
FOLDERS = {family: family for family in FAMILIES} | {"to": "export"}  # folder of each below `brushexp.plugins`
MULTI_SELECT = (
    "loss",
    "metric",
    "change",
    "callbacks",
    "logger",
    "to",
)  # families of which one run may use several members
CORE = "brushexp."  # first letters of the modules of the program itself
SEARCH_PATH = "BRUSHEXP_PLUGINS"  # environment variable: more plugin folders
USER_PACKAGE = "brushexp_plugins"  # the import name of all files found in plugin folders
