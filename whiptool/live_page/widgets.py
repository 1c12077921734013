"""Check of what browsers send for the widgets of a page: each value has to be one that its widget offers."""

from __future__ import annotations

import logging
import math
from numbers import Real
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from viser import GuiApi

_log = logging.getLogger(__name__)


def check_widgets(gui: GuiApi) -> None:
    """Drop, from now on, every update of a widget that the widget does not offer; whoever reaches a page may send any.

    Args:
        gui: Widgets of one browser's page.
    """
    from viser._messages import GuiUpdateMessage

    take, connection = gui._handle_gui_updates, gui._websock_interface

    async def take_offered(client_id: Any, message: GuiUpdateMessage) -> None:
        widget: Any = gui._gui_input_handle_from_uuid.get(message.uuid)
        if widget is not None and offered(widget, message.updates):
            await take(client_id, message)
        else:
            _log.warning("an update was dropped that no widget of the page offers: %.200r", message.updates)

    connection.unregister_handler(GuiUpdateMessage, take)
    connection.register_handler(GuiUpdateMessage, take_offered)


def offered(widget: Any, updates: dict[str, Any]) -> bool:
    """Return whether a browser may change a widget so: its value alone, to a choice of a list, true or false of a box,
    and a finite number of a slider. A number out of range is refused by the widget's function, if it has one.
    """
    if updates.keys() != {"value"}:
        return False
    value, now = updates["value"], widget._impl.value
    if widget._impl.is_button or isinstance(now, bool):
        return isinstance(value, bool)
    if (options := getattr(widget, "options", None)) is not None:
        return isinstance(value, str) and value in options
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
        return False
    return bool(widget._impl.update_cb) or widget.min <= value <= widget.max
