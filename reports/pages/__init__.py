"""Write the pages of the report, one module per page or kind of page.

``reports.pages.base`` finds the modules in the folders, so that there is no list to edit.
"""
