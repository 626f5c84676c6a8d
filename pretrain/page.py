"""HTML pages that stand alone: one style for all reports."""

from typing import Any

import jinja2


def render_page(package: str, template: str, **values: Any) -> str:  # noqa: ANN401
    """Fill a template that extends ``page.html.j2``.

    Args:
        package: In whose ``templates`` it lies.
        template: Its file name.
        values: What it shows; all that it names must be there. Text is escaped.
    """
    loader = jinja2.ChoiceLoader([jinja2.PackageLoader(name) for name in (package, "pretrain")])
    environment = jinja2.Environment(
        loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    return environment.get_template(template).render(**values)
