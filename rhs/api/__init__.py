"""For plugin authors: the records parts hand to one another, the contracts they keep, and the checks of both."""
