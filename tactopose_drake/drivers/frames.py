"""The CAN frames of these protocols, classic with 11-bit identifiers, and error frames."""

import can

# The identifier of an error frame holds its error class (linux/can/error.h); other backends follow Linux in this.
ERROR_CONTROLLER, ERROR_BUS_OFF = 0x04, 0x40


def data_frame(arbitration_id: int, data: bytes = b"") -> can.Message:
    """A frame to send.

    Args:
        arbitration_id: 11 bits.
        data: at most 8 bytes.
    """
    return can.Message(arbitration_id=arbitration_id, data=data, is_extended_id=False, is_rx=False)


def error_frame(kind: int) -> can.Message:
    """An error frame, as a CAN controller reports it to its host.

    Args:
        kind: an error class, such as `ERROR_BUS_OFF`.
    """
    return can.Message(arbitration_id=kind, data=bytes(8), is_extended_id=False, is_error_frame=True)


def is_ordinary(frame: can.Message) -> bool:
    """Whether a frame may belong to one of these protocols: a classic data frame with an 11-bit identifier.

    Frames whose length field differs from the length of their data are damaged; some backends pass them on.
    """
    special = frame.is_error_frame or frame.is_remote_frame or frame.is_extended_id or frame.is_fd
    return not special and frame.dlc == len(frame.data)
