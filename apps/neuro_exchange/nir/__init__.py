"""Networks in the Neuromorphic Intermediate Representation (NIR), with a verdict for each node.

Source: Pedersen et al., Nat. Commun. 15:8122, 2024; package `nir`.
"""
