"""Speed on this machine: the noise chain, numpy + scipy, and the limit of a core."""
