"""The figures of Meunier et al. 2009, each rebuilt from the shipped scenes and tables."""
