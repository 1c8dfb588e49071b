"""Other ways than K-Means to K templates: each method of choosing them is a file."""

from shoot.templates.methods.choice import Method, TemplateChoice, choose_templates

__all__ = ["Method", "TemplateChoice", "choose_templates"]
