"""The RTK receiver of a camera box: bytes in, a Fix with an honest sigma out, or the reason why there is none.

framing and decoders -> epoch -> gates -> averaging, strung together by session (pure); port and receiver do the rest. A
protocol is one class in decoders/, which says in neutral terms what its messages mean; nothing else knows of it.
"""
