"""Quality without a scan: what photos, normal maps and the mesh itself tell."""
