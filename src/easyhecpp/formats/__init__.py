"""Result files, exporters to other systems' formats, and the comparison of two results.

Nothing is imported here, so that a reader of one format does not pay for the others.
"""
