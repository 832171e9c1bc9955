"""Why a network does not work: checks of its description and of a short run, as findings with evidence and remedy."""
