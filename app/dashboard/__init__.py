"""Dashboard, the page: the only code that uses viser, which is loaded with `app.dashboard.page` and not before."""
