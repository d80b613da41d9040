"""Adapters to pretrained image models, one folder each.

Nothing here is imported before it is asked for: torch and transformers come with the ``models``
extra, and ``models.registry`` can say which models are ready without loading any.
"""
