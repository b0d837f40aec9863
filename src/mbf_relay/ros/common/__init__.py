"""What every node needs: conversions, transforms, parameters, diagnostics, node life, actions."""
