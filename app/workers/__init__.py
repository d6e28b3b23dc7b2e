"""Main functions of the processes beside this one; only the launcher names them."""
