"""Coverage-guided fuzzing of every parser of ours: `make fuzz`, by hand and weekly. A target is a module with

SEEDS       inputs to begin with
DICTIONARY  words to make inputs of, as libFuzzer writes them
read        takes an input, and lets through only what is our own fault
"""

TARGETS: dict[str, tuple[str, ...]] = {  # and the modules whose branches guide the search
    "door": ("app.gateway.server", "app.gateway.whence", "app.gateway.answers", "app.gateway.relay", "app.access"),
    "formula": ("environments.formula", "environments.expression", "environments.tape"),
    "matrix": ("app.dashboard.matrix_text", "app.printable"),
    "messages": ("app.dashboard.messages", "viser.infra._messages"),
    "recording": ("app.data_files", "zipfile", "numpy.lib._format_impl"),
    "scenario": ("app.scenario_data", "tomllib"),
    "urdf": ("environments.urdf", "environments.robots", "environments.dexterity"),
}
