"""Exceptions of zipfile, its decompressors and numpy for archives that are broken, encrypted or compressed by an
unknown method, and for headers that are no Python literals."""

import lzma
import struct
import tokenize
import zipfile
import zlib

UNREADABLE = (
    *(ValueError, TypeError, SyntaxError, ArithmeticError, LookupError, EOFError, RuntimeError),
    *(tokenize.TokenError, zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
)
