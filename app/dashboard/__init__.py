"""The page: the only code that knows viser, which is loaded with `app.dashboard.page` and not before."""
