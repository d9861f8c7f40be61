"""One name, one meaning (docs/glossary.md): a public name that two files define must mean the same in both."""

import ast
from collections import defaultdict

import pytest

from tests.source import PACKAGE, trees

#: Functions that several modules define, each called through its module (`codec.pack`), with their one meaning.
SAME_MEANING = {
    "recipes": "the recipes that the attempts of a query were made with",
    "selection": "the attempts that a query names, in the order of their records",
    "attempts": "the attempts that a query names",
    "calibrate": "from samples to calibration and verdict: of one unit, of every unit of a table",
    "drawn_over": "what the residual of an effect is drawn against",
    "held_out_gain": "the gain measured on held-out data",
    "lines": "sentences for a person, line by line",
    "canonical": "the one spelling of what can be written in several ways",
    "changed_days": "days whose yields may have altered",
    "check": "refuses, or gives reasons against, what it is handed",
    "coefficients": "the coefficients of a calibration, as a document or a certificate lists them",
    "command": "a command of the command line, or a person's action on the page",
    "compare": "holds what is there against what was there before",
    "count": "how many a query names",
    "decode": "from bytes to values",
    "document": "the plain document of a value, as JSON keeps it",
    "download": "writes an object over SDO",
    "draw": "makes a figure",
    "encode": "from values to bytes",
    "environment": "the templates of a face",
    "fastest": "the order of least moving time",
    "faults": "the gross faults that one check finds in a diagnosis' data; a test compares the checks",
    "find": "looks through data for what is there",
    "findings": "everything wrong with records",
    "fit": "estimates parameters from data",
    "form_of": "the form in which something came",
    "frames": "raw frames of attempts",
    "gather": "all figures for Prometheus",
    "grant": "lets a person's role see stations and products",
    "inspect": "looks over a diagnosis' data before anything is fitted",
    "likelihoods": "log-likelihoods of noise shapes",
    "load": "reads what was stored under a name",
    "matrix_of": "the matrix that numbers or a text stand for",
    "means": "means of the positions",
    "missing": "what is not there and should be",
    "names": "names in the order in which they come",
    "of": "the thing of its module that belongs to the argument: `method.of(recipe)`",
    "of_attempt": "what the log holds of one attempt, as a document or a certificate's facts",
    "pack": "from frames to bytes",
    "page": "a page as text",
    "parse": "from text to a value, or a sentence that says what is wrong",
    "read": "from a file or bytes to values",
    "recompute": "refits a stored attempt and compares; the page's route calls the use case",
    "retire": "removes what has outlived its time",
    "run_reader_process": "the other process of a reader of untrusted files",
    "samples_table": "makes a samples table",
    "save": "stores durably",
    "search": "looks for the best, or for what fits a question",
    "sentence": "one sentence for a person",
    "serve": "answers until it is stopped",
    "show": "the route of a page",
    "solve": "solves linear equations, least squares included",
    "spectrum": "eigenvalues or singular values",
    "step_of": "the step of the grid that readings lie on",
    "to_plain": "from values to plain bytes or JSON",
    "translate_errors": "a library's complaints as errors of the station",
    "unit_of": "the unit of measurement of a number",
    "unpack": "from bytes to what was packed",
    "upload": "reads an object over SDO",
    "verification_visits": "the visits measured again after the write",
    "verify": "holds a result against evidence from elsewhere",
    "where": "the SQL condition of a query",
    "with_model": "the same with the causes of a model known",
    "yields": "first-pass and final yield by group",
}


def definitions(kind: type[ast.stmt] | tuple[type[ast.stmt], ...]) -> dict[str, list[str]]:
    """Public names at the top of modules that more than one file defines, with the files."""
    found: dict[str, list[str]] = defaultdict(list)
    for path, tree in trees().items():
        for node in tree.body:
            name = getattr(node, "name", "_")
            if isinstance(node, kind) and not name.startswith("_"):
                found[name].append(str(path.relative_to(PACKAGE)))
    return {name: files for name, files in found.items() if len(files) > 1}


def test_no_class_name_is_defined_twice() -> None:
    assert definitions(ast.ClassDef) == {}


def test_a_function_s_name_means_one_thing() -> None:
    twice = definitions((ast.FunctionDef, ast.AsyncFunctionDef))
    assert {name: files for name, files in twice.items() if name not in SAME_MEANING} == {}


def test_the_list_of_same_meanings_holds_no_more_than_it_needs() -> None:
    assert SAME_MEANING.keys() - definitions((ast.FunctionDef, ast.AsyncFunctionDef)).keys() == set()


@pytest.mark.parametrize("word", ["told", "deeds", "laid", "alike", "hero", "crowd"])
def test_no_module_class_or_public_function_bears_a_private_word(word: str) -> None:
    files = [str(path.relative_to(PACKAGE)) for path in trees() if word in path.stem.split("_")]
    names = [
        node.name
        for tree in trees().values()
        for node in tree.body
        if isinstance(node, ast.ClassDef | ast.FunctionDef)
        and not node.name.startswith("_")
        and word in node.name.lower().split("_")
    ]
    assert (files, names) == ([], [])
