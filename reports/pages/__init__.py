"""One module a page or a kind of page, in folders; ``reports.pages.base`` finds them, there is no list to edit."""
