"""Where the models and diagrams that ship with the package are found."""

from pathlib import Path


def resource_root() -> Path:
    """The folder that holds `models/` and `diagrams/`: the package itself when installed, the checkout otherwise."""
    package = Path(__file__).resolve().parent
    return package if (package / "models").is_dir() else package.parent


def model_path(*parts: str) -> Path:
    """The path of a shipped model, e.g. `model_path("objects", "mug.obj")`."""
    return resource_root().joinpath("models", *parts)
