"""The report of a recording: one HTML file that needs nothing else. Needs Jinja2."""

from .page import render_report

__all__ = ["render_report"]
