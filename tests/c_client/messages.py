"""Random contacts, over everything that the schema allows and a C string can hold."""

from __future__ import annotations

from typing import Any

import msgspec
from hypothesis import strategies as st

from fmfts.bus.messages import ContactMessage, FingerMessage, NowMessage, PoseMessage, SlipMessage

# The daemon's encoder adds them all to check that they are finite.
LARGEST = 1e300
numbers = st.floats(-LARGEST, LARGEST) | st.sampled_from([0.0, -0.0, 5e-324, LARGEST])
vectors = st.tuples(numbers, numbers, numbers)
characters = st.characters(exclude_characters="\0", exclude_categories=("Cs",))
words = st.text(characters, max_size=16)

BY_HINT: dict[str, st.SearchStrategy[Any]] = {
    "int": st.integers(-(2**63), 2**63 - 1),
    "float": numbers,
    "float | None": numbers | st.none(),
    "Vector": vectors,
    "Vector | None": vectors | st.none(),
    "bool": st.booleans(),
    "bool | None": st.booleans() | st.none(),
    "str": words,
    "str | None": words | st.none(),
    "Health": st.sampled_from(["ok", "degraded", "disturbed", "lost", "stale", "disconnected", "no_baseline"]),
}


def built(kind: type[Any], **fixed: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Structs of `kind` with fields drawn by their annotations."""
    hints = {name: hint for base in kind.__mro__ for name, hint in getattr(base, "__annotations__", {}).items()}
    names = [field.name for field in msgspec.structs.fields(kind)]
    return st.builds(kind, **{name: fixed[name] if name in fixed else BY_HINT[hints[name]] for name in names})


poses = built(PoseMessage)
nows = built(NowMessage)
reasons = st.text(characters, max_size=400)
unset = st.just(msgspec.UNSET)
contacts = built(
    ContactMessage,
    v=st.just(1),
    reason=reasons,
    pose=poses | st.none(),
    now=nows | st.none(),
    slip=unset | built(SlipMessage),
    contacts=unset | st.none() | st.lists(built(FingerMessage), max_size=6),
    more=unset | st.booleans(),
    poses=unset | st.none() | st.lists(poses, max_size=2),
)

# Any value of msgpack.
anything = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(characters, max_size=5)
    | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(words, inner, max_size=3),
    max_leaves=6,
)
