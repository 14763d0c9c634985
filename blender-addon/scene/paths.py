"""Data paths of shape keys."""


def value_path(name: str) -> str:
    """The data path of the value of a shape key."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return f'key_blocks["{escaped}"].value'
