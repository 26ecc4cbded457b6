"""Run the interior-point iterations of the clique-tree method."""
