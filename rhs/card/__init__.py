"""A page about one part: does it keep its contract, how good is it beside ours, where does it break, what does it cost?"""
