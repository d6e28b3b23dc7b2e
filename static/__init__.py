"""Files that ship beside the code; read them through `importlib.resources.files("static")`."""
