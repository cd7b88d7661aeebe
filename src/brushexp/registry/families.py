"""Define the plugin families, their folders, and where plugins are found."""

FAMILIES = {
    "painter": "target picture -> strokes, state by state",
    "palette": "colours of the picture -> colours of the target",
    "init": "target picture -> initial strokes",
    "renderer": "stroke parameters -> what each stroke covers",
    "blend": "strokes in depth order -> picture",
    "color": "the space in which paint is composited",
    "paper": "paper or canvas: its relief, and the parts that paint skips",
    "order": "strokes -> depth",
    "loss": "painting -> number to minimise",
    "metric": "finished painting -> measure of quality",
    "density": "when to add and remove strokes",
    "sampler": "which part of the canvas a step compares",
    "optimizer": "how strokes move",
    "change": "changes to one painting",
    "engine": "brush simulators: stroke parameters -> picture of one stroke",
    "callbacks": "extra actions during a fit",
    "logger": "destinations of the curves of a run",
    "to": "finished painting -> files for other programs",
}
FOLDERS = {family: family for family in FAMILIES} | {"to": "export"}  # folder of each family below `brushexp.plugins`
MULTI_SELECT = (
    "loss",
    "metric",
    "change",
    "callbacks",
    "logger",
    "to",
)  # families of which a run may have several members
CORE = "brushexp."  # prefix of the program's own modules
SEARCH_PATH = "BRUSHEXP_PLUGINS"  # environment variable with more plugin folders
USER_PACKAGE = "brushexp_plugins"  # import name of all files in plugin folders
