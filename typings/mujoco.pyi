# A C++ extension, and an optional one: the type checker must not need it.
from typing import Any

def __getattr__(name: str) -> Any: ...
