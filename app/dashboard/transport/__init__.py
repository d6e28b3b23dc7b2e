"""Transport between the browser and viser: handshake, messages, slow clients."""
