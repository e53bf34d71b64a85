"""The bytes of an array in VTK's XML files: a header with its size, and blocks that may be compressed."""

import binascii
import lzma
import zlib
from collections.abc import Callable

import numpy as np

from quadriform.errors import FileFormatError
from quadriform.files.reading import check_budget

DAMAGED = (ValueError, OverflowError, IndexError, binascii.Error, zlib.error, lzma.LZMAError, EOFError)
"""What damaged content raises."""


def unpacked(packed: bytes, header: str, compressor: str, where: str) -> bytes:
    """The bytes of an array.

    Args:
        packed: its header and its content as they lie in the file.
        header: NumPy's name of the type of the header's numbers.
        compressor: VTK's name of the class that compressed it; empty for none.
        where: the file and the array.

    Raises:
        FileFormatError: an unknown compressor, or one that is not installed.
        FileLimitError: the header declares more than the budget.
        DAMAGED: the content is not what the header declares.
    """
    width = np.dtype(header).itemsize
    count = int(np.frombuffer(packed[:width], header)[0])  # of bytes, or of blocks
    if not compressor:
        content = packed[width:]
        if count > len(content) or content[count:].strip():  # line ends may follow
            raise ValueError(f"{count} bytes declared, {len(content)} found")
        return content[:count]
    decompress = _decompressor(compressor, where)
    if count * width > len(packed):
        raise ValueError(f"{count} blocks declared in {len(packed)} bytes")
    sizes = np.frombuffer(packed[: (3 + count) * width], header).astype(object)[1:]  # Python's integers: no overflow
    if count == 0:
        return b""
    # Unpacked sizes of a block and of the last one, 0 where that is as long, then the packed size of each.
    lengths = [sizes[0]] * (count - 1) + [sizes[1] or sizes[0]]
    check_budget(sum(lengths), where)
    at, blocks = (3 + count) * width, []
    for size, length in zip(sizes[2:], lengths):
        blocks.append(decompress(packed[at : at + size], length))
        if len(blocks[-1]) != length:
            raise ValueError(f"a block of {length} bytes declared, {len(blocks[-1])} found")
        at += size
    return b"".join(blocks)


def _decompressor(name: str, where: str) -> Callable[[bytes, int], bytes]:
    if name == "vtkZLibDataCompressor":
        return lambda block, length: zlib.decompressobj().decompress(block, length + 1)
    if name == "vtkLZMADataCompressor":
        return lambda block, length: lzma.LZMADecompressor().decompress(block, length + 1)
    if name == "vtkLZ4DataCompressor":
        return _lz4(where)
    raise FileFormatError(f"{where}: compressed by {name!r}, which is not known; save it with zlib or uncompressed")


def _lz4(where: str) -> Callable[[bytes, int], bytes]:
    try:
        from lz4 import block
    except ImportError as error:
        raise FileFormatError(
            f"{where}: compressed with LZ4; save it with zlib or uncompressed, or install the package lz4"
        ) from error

    def decompress(packed: bytes, length: int) -> bytes:
        try:
            return bytes(block.decompress(packed, uncompressed_size=length))
        except block.LZ4BlockError as error:
            raise ValueError(str(error)) from error

    return decompress
