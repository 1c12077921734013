"""Commands draw neither figures nor films, which take each of them seconds, but where a test looks at them."""

from undrawn import nothing_drawn  # noqa: F401
