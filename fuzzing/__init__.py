"""Coverage-guided fuzzing of every parser of ours: `make fuzz`, by hand and weekly. A target is a module with

SEEDS       inputs to begin with
DICTIONARY  words to make inputs of, as libFuzzer writes them
read        takes an input, and lets through only what is our own fault
"""

TARGETS: dict[str, tuple[str, ...]] = {  # and the modules whose branches guide the search
    "door": (
        "app.gateway.server",
        "app.gateway.access_control",
        "app.gateway.class_pages",
        "app.gateway.session_request",
        "app.gateway.visitor_origin",
        "app.gateway.responses",
        "app.gateway.relay",
        "app.access.admission",
    ),
    "formula": ("environments.formula", "environments.expression", "environments.bytecode"),
    "matrix": ("app.dashboard.widgets.fields.matrix_text", "app.process.terminal_text"),
    "messages": ("app.dashboard.transport.messages", "viser.infra._messages"),
    "recording": ("app.storage.recording_files", "zipfile", "numpy.lib._format_impl"),
    "scenario": ("app.scenario.data", "tomllib"),
    "urdf": ("environments.urdf", "environments.robots", "environments.working_posture"),
}
