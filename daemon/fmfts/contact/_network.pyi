from typing_extensions import Buffer

MAX_HIDDEN: int

def infer(vector: Buffer, pose: Buffer, contact: Buffer, jacobian: Buffer, /) -> None: ...
