"""Speed on this machine: the noise chain, numpy + scipy, and the core's limit."""
