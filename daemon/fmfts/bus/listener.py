"""Stops and allows new connections to a tcp endpoint that ZeroMQ serves. Existing ones stay open.

libzmq has no such option. So the kernel drops the first packet of each new connection: a socket filter on libzmq's own
listening socket, which any thread of this process may set at any time. The other side sends that packet again after a
second, then after two and so on, until it is let in.
"""

from __future__ import annotations

import ctypes
import os
import socket
import struct

import zmq

SO_ATTACH_FILTER, SO_DETACH_FILTER = 26, 27  # constants of Linux for which Python has no names
DROP_ALL = struct.pack("=HBBI", 0x06, 0, 0, 0)  # struct sock_filter, BPF_RET: keep no byte of the packet


class Listener:
    """descriptor: of a listening socket; this makes a duplicate, which `close` closes."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.socket(fileno=os.dup(descriptor))

    def let_in(self, wanted: bool) -> None:
        """May new connections come in?"""
        if wanted:
            self._socket.setsockopt(socket.SOL_SOCKET, SO_DETACH_FILTER, 0)
        else:
            program = ctypes.create_string_buffer(DROP_ALL, len(DROP_ALL))
            filter_ = struct.pack("@HP", 1, ctypes.addressof(program))  # struct sock_fprog
            self._socket.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, filter_)

    def close(self) -> None:
        self._socket.close()


def bound_to_tcp(bus_socket: zmq.Socket[bytes], endpoint: str) -> Listener:
    """Bind; raises zmq.ZMQError. libzmq's monitor names the descriptor of the socket that listens."""
    from zmq.utils.monitor import recv_monitor_message  # brings asyncio along, which nothing else here needs

    monitor = bus_socket.get_monitor_socket(zmq.EVENT_LISTENING)
    try:
        bus_socket.bind(endpoint)
        return Listener(recv_monitor_message(monitor)["value"])
    finally:
        bus_socket.disable_monitor()
        monitor.close(linger=0)
