"""The mark that weights carry: of which templates they are."""

from collections.abc import Mapping
from typing import Any

from lss_core.errors import DataError
from shoot.templates import TemplateSet

TEMPLATES_MARK = "templates_sha256"


def check_mark(stored: Mapping[str, Any], templates: TemplateSet, name: str) -> None:
    """Check that stored weights were trained with these templates.

    Args:
        stored: What lies beside them.
        templates: What they are to be used with.
        name: Words for where they are.

    Raises:
        DataError: If not.
    """
    trained_with = stored.get(TEMPLATES_MARK)
    if trained_with != templates.sha256:
        raise DataError(
            f"{name} was trained with other templates (sha256 {str(trained_with)[:12]}..., "
            f"these are {templates.sha256[:12]}...); give it its own template file."
        )
