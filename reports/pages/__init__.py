"""One module a page or a kind of page; ``reports.pages.base`` finds them, there is no list to edit."""
