"""The CAN frames of these protocols: classic, 11-bit identifiers; and what an error frame says."""

import can

# Linux writes what an error frame is about into its identifier (linux/can/error.h); other backends copy that.
ERROR_CONTROLLER, ERROR_BUS_OFF = 0x04, 0x40


def data_frame(arbitration_id: int, data: bytes = b"") -> can.Message:
    """A frame to send.

    Args:
        arbitration_id: 11 bits.
        data: at most 8 bytes.
    """
    return can.Message(arbitration_id=arbitration_id, data=data, is_extended_id=False, is_rx=False)


def error_frame(kind: int) -> can.Message:
    """An error frame, as a CAN controller reports one to its host.

    Args:
        kind: one of the bits above.
    """
    return can.Message(arbitration_id=kind, data=bytes(8), is_extended_id=False, is_error_frame=True)


def is_ordinary(frame: can.Message) -> bool:
    """Whether a frame may belong to one of these protocols: up to 8 bytes of data, 11-bit identifier.

    A classic frame whose length field disagrees with its data is damaged; some backends let it through.
    """
    special = frame.is_error_frame or frame.is_remote_frame or frame.is_extended_id or frame.is_fd
    return not special and frame.dlc == len(frame.data)
