"""Access control of a server (origins, tokens, rate limits), and the messages between gateway and session."""
