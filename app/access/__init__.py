"""Who may speak to a server, and how much: origins, tokens, rate limits; what gateway and session tell each other."""
