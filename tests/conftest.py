import hypothesis

# The first call of a compiled kernel takes long; timing is the benchmarks' business.
hypothesis.settings.register_profile("tactopose", deadline=None)
hypothesis.settings.load_profile("tactopose")
