"""The memory of a service: what threads have freed does not stay with them."""

import ctypes
import subprocess
import sys

import pytest
from depth import deep
from waiting import HANG

#: Bytes of large blocks that the system was asked for each by itself, after larger ones than these were freed.
ASKED = """
import ctypes
from gear_rattle.service.web.server import make_malloc_return_memory
class Info(ctypes.Structure):
    names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = [(name, ctypes.c_size_t) for name in names.split()]
if {serves}:
    make_malloc_return_memory()
mallinfo = ctypes.CDLL(None).mallinfo2
mallinfo.restype = Info
freed = bytearray(24 << 20)
del freed
before = mallinfo().hblkhd
kept = bytearray(8 << 20)
print(mallinfo().hblkhd - before)
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallinfo2"), reason="another C library than glibc from 2.33 on")
@pytest.mark.parametrize("serves", [True, pytest.param(False, marks=deep)])
def test_large_arrays_of_a_service_go_back_to_the_system_when_they_are_freed(serves: bool) -> None:
    """Without the limit glibc takes them from a thread's arena once a larger one was freed, and keeps them there."""
    asked = ASKED.format(serves=serves)
    said = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, timeout=HANG, check=True)
    assert (int(said.stdout) >= 8 << 20) == serves, said.stdout
