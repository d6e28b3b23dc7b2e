# A C++ extension that fills its namespace at run time: there is nothing in it for a type checker to read.
from typing import Any

def __getattr__(name: str) -> Any: ...
