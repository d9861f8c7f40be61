"""A unit's certificate out of the log."""

from station.domain.recipe.recipe import Recipe
from station.ports.log_reader import Attempt, LogReader
from station.reporting.certificate.document import Certificate, build
from station.reporting.words import Words
from station.service.witnessed import newest_receipt


def certificate_of(log: LogReader, attempt: Attempt, words: Words) -> Certificate:
    """The certificate of one ended attempt. Errors: LogError where it came to no calibration."""
    recipe = Recipe.model_validate_json(log.recipe_and_product(attempt)[0])
    return build(log.attempt(attempt), recipe, log.head(), words, receipt=newest_receipt(log))
