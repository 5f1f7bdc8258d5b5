"""How many bad inputs are tried: some hundreds in `make test`, always the same; thousands in `make stability`."""

from hypothesis import HealthCheck, settings

settings.register_profile(
    "fast",
    max_examples=40,
    derandomize=True,  # a test that fails by chance is of no use
    deadline=None,  # no test on time
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],  # folders are shared on purpose
)
settings.register_profile("thorough", settings.get_profile("fast"), max_examples=5000, derandomize=False)
settings.load_profile("fast")
