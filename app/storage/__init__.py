"""Storage on disk: recordings, uploaded URDFs, meshes of links, constants over Omega."""
