"""Mutants that may survive, by file, as ``make mutants`` shows them; each with its reason."""

_SET_FIRST = 'it is set before it is read'

EXCUSED: dict[str, dict[str, str]] = {
    'safety_mux/button.py': {
        'ResetButton.__init__: self._since = 0.0 -> pass': _SET_FIRST,
        'ResetButton.__init__: 0.0 -> 1.0': _SET_FIRST,
        'ResetButton.hear: pressed and (not before) -> not before': (
            'while the button is released, neither time nor fault is read'
        ),
    },
}
