"""How the house is built: which way imports run, that exported names exist, that no engine knows refkin's geometry."""

from __future__ import annotations

import ast
import importlib
import re
from graphlib import TopologicalSorter

import pytest

from refkin.joints import DRIVER_TYPES, JOINT_TYPES, SPATIAL_DRIVER_TYPES, SPATIAL_JOINT_TYPES, Disc, Driver, Polar
from tests.houseplan import ROOT, arrows, floors, folded, imported, module_of, modules, sources, tree

ENGINE_PACKAGES = {"exudyn", "pinocchio", "mujoco", "coal"}
TYPES_AND_LAWS = {"refkin.model", "refkin.motion", "refkin.motion_laws", "refkin.joints", "refkin.errors"}
TYPES_AND_LAWS |= {"refkin.proof.numbers.extrema"}
"""What an adapter may know of refkin: what a scene says, when its laws turn back, and the type of an answer."""
NEWTON = {"refkin.newton", "refkin.differences"}
"""Vector loops are solved by refkin's Newton, which knows no joint."""
OURS = ROOT / "crosscheck" / "engines" / "ours"
"""Producers of our own formulas: refkin itself, its fast path, SciPy's solvers on its equations. They are no peers."""


@pytest.mark.parametrize("path", sources("refkin"), ids=lambda p: str(p.relative_to(ROOT)))
def test_refkin_imports_neither_crosscheck_nor_an_engine(path):
    packages = {name.split(".")[0] for name in imported(path)}

    assert not packages & (ENGINE_PACKAGES | {"crosscheck", "tests"})


def within(package):
    """Return the import graph of a package, without its face."""
    inner = {name: others for name, others in arrows().items() if name.startswith(f"{package}.")}
    return {name: {other for other in others if other in inner} for name, others in inner.items()}


OF_REFKIN = ("reference", "output", "scenes", "proof", "solving", "fast")
"""Layers from below; what is in none of the folders is the reference. The fast paths fall back on `refkin.solve`."""


def layer(name):
    folder = name.split(".")[1]
    return folder if folder in OF_REFKIN else "reference"


def test_in_refkin_nothing_imports_upward():
    """The face of the package hands on what stands above, when asked: not read."""
    floor = {name: OF_REFKIN.index(layer(name)) for name in within("refkin")}
    imports = [(name, other) for name, others in within("refkin").items() for other in others]

    assert [(name, other) for name, other in imports if floor[other] > floor[name]] == []


@pytest.mark.parametrize("package", ["refkin", "crosscheck"])
def test_nothing_in_a_package_imports_its_face(package):
    """The face asks for what stands above when it is wanted: through it any file would reach all of them."""
    assert [name for name, others in arrows().items() if name.startswith(f"{package}.") and package in others] == []


LATER = {
    *("cams.py", "contact_kinematics.py", "own_coordinates.py", "annotations.py"),
    *("elements.py", "spatial_elements.py", "spatial_passive.py"),
}
"""Cams, and what joints count, are a chapter that may be left for another day, as are types of fields; elements, and
what is found of them alone, serve who solves no formula."""


SECTION = re.compile(r"^ +Parameters\n +-+\n.*?(?=\n *\n|\n *\"\"\")", re.DOTALL | re.MULTILINE)


def lines(paths):
    """The lines that are read: blank ones are not, and tables of parameters are looked up."""
    texts = (SECTION.sub("", path.read_text(encoding="utf-8")) for path in paths)
    return sum(bool(line.strip()) for text in texts for line in text.splitlines())


def test_the_reference_is_read_in_one_sitting():
    """Its spine is all but the joints."""
    spine = [p for p in sources("refkin") if p.parent == ROOT / "refkin"]
    joints = [path for path in sources("refkin/joints") if path.name not in LATER]
    of_space = [path for path in joints if path.name.startswith("spatial")]

    assert lines(spine) <= 1240
    assert lines(spine) + lines(joints) - lines(of_space) <= 1986
    assert lines(of_space) <= 1106  # the second chapter that may be left for another day: bodies of space


def test_source_and_tests_stay_as_long_as_they_are():
    """A change leaves them no longer, or raises this bar and says why."""
    size = {folder: sum(path.read_text(encoding="utf-8").count("\n") for path in sources(folder)) for folder in ALL}

    assert size["refkin"] + size["crosscheck"] <= 63_677
    assert size["tests"] <= 51_043


ALL = ("refkin", "crosscheck", "tests")


@pytest.mark.parametrize("path", sources("crosscheck"), ids=lambda p: str(p.relative_to(ROOT)))
def test_of_crosscheck_only_what_shows_the_fast_path_needs_it(path):
    """At the top of a module: a command may import it when it is called."""
    top = [node for node in tree(path).body if hasattr(node, "names")]
    names = [f"{getattr(node, 'module', '')}.{alias.name}".lstrip(".") for node in top for alias in node.names]

    assert path.name == "batch.py" or not [name for name in names if name.startswith("refkin.fast")]


def adapters():
    return [path for path in sources("crosscheck/engines") if OURS not in path.parents]


@pytest.mark.parametrize("path", adapters(), ids=lambda p: str(p.relative_to(ROOT)))
def test_an_adapter_shares_no_geometry_with_refkin(path):
    of_refkin = {module_of(name) for name in imported(path) if name.split(".")[0] == "refkin"}

    assert not of_refkin - TYPES_AND_LAWS - (NEWTON if path.parent.name == "vector_loop" else set())


@pytest.mark.parametrize("path", adapters(), ids=lambda p: str(p.relative_to(ROOT)))
def test_an_adapter_calls_no_formula_of_a_joint(path):
    formulas = {"residual", "jacobian", "nu", "gamma", "constants", "inputs"}
    of_a_joint = [
        node
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Attribute)
        and node.attr in formulas
        and isinstance(node.value, ast.Name)
        and node.value.id
        in {"joint", "driver", "constraint", "Revolute", "Prismatic", "Distance", "PointOnLine", "Fixed"}
    ]

    assert not of_a_joint


@pytest.mark.parametrize("path", adapters(), ids=lambda p: str(p.relative_to(ROOT)))
def test_no_engine_imports_another(path):
    own = path.parent.name
    others = {n.split(".")[0] for n in imported(path)} & ENGINE_PACKAGES - {own}
    folders = {n.split(".")[2] for n in imported(path) if n.startswith("crosscheck.engines.")}

    assert not others - ({"coal"} if own == "pinocchio" else set())
    assert not folders & {"exudyn", "mujoco", "pinocchio", "closed_form", "vector_loop", "ours"} - {own}


@pytest.mark.parametrize(
    "package", ["refkin", "crosscheck", "crosscheck.strategies", "refkin.scenes.linkages", "refkin.proof"]
)
def test_every_exported_name_exists(package):
    module = importlib.import_module(package)

    assert module.__all__
    assert not [name for name in module.__all__ if not hasattr(module, name)]


AROUND = {
    "refkin": {"import_module", "globals"},  # the face hands on what it is asked for by name
    "refkin.fast.elimination.program": {"exec"},  # the instruction list as a function
    "crosscheck.engines.loading": {"import_module", "spec_from_file_location", "exec_module", "modules"},  # a user's
    "crosscheck.engines.methods": {"import_module"},
    "crosscheck.engines.undisturbed": {"builtins", "modules"},  # compares what an engine may have changed
    "crosscheck.documents.ledger.judging": {"import_module"},  # the rows of the ledger name their functions
    "crosscheck.workers.processes": {"modules"},  # a child is not to import the parent's `__main__`
}
WAYS = r"import_module|__import__|spec_from_\w+|(exec|load)_module|run_(path|module)|runpy|pkgutil|zipimport|exec|eval|"
WAYS += r"globals|modules|builtins|__builtins__|__dict__|__loader__|__spec__|resolve_name|find_spec|\w*FileLoader"


def test_a_module_is_imported_where_the_graph_sees_it():
    """Ways to a module that no test here sees stand where they are known, and why."""
    values = {}
    for module, path in modules().items():
        parts = {part for name in imported(path) for part in name.split(".")}
        texts = {x.value for x in ast.walk(tree(path)) if isinstance(x, ast.Constant) and isinstance(x.value, str)}
        values[module] = {x for x in named(tree(path)) | parts | texts if re.fullmatch(WAYS, x)}

    assert {module: ways for module, ways in values.items() if ways} == AROUND


def test_no_files_import_each_other_in_a_circle():
    assert [*TopologicalSorter(arrows()).static_order()]  # a CycleError names the files


def folder_of(name):
    """Return the folder of a module; a package's `__init__` is one of its own modules.

    The top of refkin and its joints are the reference, one layer by the plan. What stands at crosscheck's top counts
    file by file: `errors` is below all folders, `cli` and `__main__` above them.
    """
    folder = name if modules()[name].name == "__init__.py" else name.rpartition(".")[0]
    return name if folder == "crosscheck" else {"refkin.joints": "refkin"}.get(folder, folder)


def test_no_folders_import_each_other_in_a_circle():
    assert [*TopologicalSorter(folded(arrows(), folder_of)).static_order()]


OF_CROSSCHECK = (
    {"errors", "strategies"},
    {"scenes"},
    {"engines"},
    {"workers", "judge"},  # how a child process fails, and what an answer is worth, know nothing of each other
    {"documents", "measure", "problems"},  # the ledger recomputes what others printed: it asks engines, and no worker
    {"night"},
    {"report"},
    {"commands"},
    {"cli"},
    {"__main__"},
)
"""Who may import whom in crosscheck: only what stands above it here."""


def test_nothing_in_crosscheck_imports_upward_or_sideways():
    floor = {name: k for k, names in enumerate(OF_CROSSCHECK) for name in names}
    graph = folded(within("crosscheck"), lambda name: name.split(".")[1])

    assert set(graph) == set(floor)
    assert [(name, other) for name, others in graph.items() for other in others if floor[other] >= floor[name]] == []


def test_crosscheck_is_at_most_eight_floors_of_folders_and_twelve_of_files():
    files = within("crosscheck")
    folders = folded(files, lambda name: name.split(".")[1])
    top = {"cli", "__main__", "errors"}

    assert floors({name: others - top for name, others in folders.items() if name not in top}) <= 8
    assert floors(files) <= 12  # the plan says 20


def test_at_most_three_modules_stand_at_the_top_of_crosscheck():
    assert len(list((ROOT / "crosscheck").glob("*.py"))) - 1 <= 3  # but for its face


TYPES = (*JOINT_TYPES, *DRIVER_TYPES, *SPATIAL_JOINT_TYPES, *SPATIAL_DRIVER_TYPES)
JOINT_NAMES = {cls.__name__ for cls in (*TYPES, Driver, Disc, Polar)}
COMMON = {"angle", "cam", "displacement", "distance", "fixed", "screw"}
"""Words of types that mean other things too: they count where they are compared. (x and y are coordinates.)"""
WORDS = {cls.type for cls in TYPES} - COMMON - {"x", "y"} | JOINT_NAMES - {"Driver"}
AS_DATA = {"refkin", "crosscheck.documents.ledger.shabana_counts", "crosscheck.engines.spatial.kinds"}
AS_DATA |= {"crosscheck.scenes.conformance", "crosscheck.scenes.conformance_space"}
"""Where words are names: of what is exported, counted on paper, made out from elements; of questions to an engine."""
MOST_QUESTIONS = 12
"""How often a joint's type is asked for outside `refkin/joints`: the plan says 15; 124 times at b3b28a8."""


def asking(node):
    """Return the parts of a node that ask which type a joint is where they name a class, or read `type`."""
    match node:
        case ast.Call(func=ast.Name(id="isinstance" | "issubclass"), args=[_, *parts]):
            return parts
        case ast.Call(func=ast.Attribute(attr="register" | "get" | "fromkeys"), args=parts) | ast.Dict(keys=parts):
            return filter(None, parts)
        case ast.Match(subject=part) | ast.DictComp(key=part):
            return [part]
        case ast.Compare() | ast.MatchClass() | ast.MatchValue() | ast.Subscript():
            return ast.iter_child_nodes(node)
        case ast.Tuple() | ast.List() | ast.Set() | ast.Assign():  # of classes
            return [x for x in getattr(node, "elts", [getattr(node, "value", None)]) if JOINT_NAMES & {*own_names(x)}]
        case ast.alias(name=name, asname=str()):
            return [ast.Name(name)]
    return ()


def own_names(node):
    return getattr(node, "id", ""), getattr(node, "attr", "")


def is_question(node, annotated):
    parts = [x for part in asking(node) if part not in annotated for x in ast.walk(part)]
    words = {getattr(x, "value", "") for x in parts if isinstance(node, ast.Compare | ast.MatchValue)} & COMMON
    read = isinstance(node, ast.Call) and {"type", "__class__"} & {getattr(x, "value", "") for x in node.args}
    names = {name for x in parts for name in own_names(x) if isinstance(x, ast.Attribute) or name != "type"}  # type(x)
    asked = names & {*JOINT_NAMES, "type", *(x for x in names if x.endswith("_TYPES"))}
    return words or read or asked or {"singledispatch", "singledispatchmethod", "__class__"} & {*own_names(node)}


def questions(module, path):
    """Yield where a file asks which type a joint is: of its class, its `type` or its name; by a pattern, by a table."""
    nodes = list(ast.walk(tree(path)))
    slices = [x.slice for x in nodes if isinstance(x, ast.Subscript) and JOINT_NAMES & named(x.slice)]  # list[Revolute]
    annotated = {x for part in slices for x in ast.walk(part)}
    for node in nodes:
        said = isinstance(node, ast.Constant) and module not in AS_DATA and node.value in WORDS
        if said or (node not in annotated and is_question(node, annotated)):
            yield f"{path.relative_to(ROOT)}:{node.lineno}"


def named(node):
    """Return the names in an expression: `Revolute` of `Revolute` and of `joints.Revolute`."""
    inner = list(ast.walk(node))
    return {x.id for x in inner if isinstance(x, ast.Name)} | {x.attr for x in inner if isinstance(x, ast.Attribute)}


def test_no_adapter_imports_the_type_of_a_joint():
    """Nor can it ask for one by another name then."""
    names = {path: {name.rpartition(".")[2] for name in imported(path)} for path in adapters()}

    assert {path: said & JOINT_NAMES for path, said in names.items() if said & JOINT_NAMES} == {}


def test_a_joint_is_built_from_its_elements_not_from_its_type():
    others = {module: path for module, path in modules().items() if path.parent.name != "joints"}
    values = [where for module, path in others.items() for where in questions(module, path)]

    assert len(values) <= MOST_QUESTIONS, values
    assert not [where for where in values if where.startswith("crosscheck/engines")]


def classes():
    """Yield (module, class) for every class of the two packages."""
    for name, path in modules().items():
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ClassDef):
                yield name, node


def test_one_class_is_the_method_of_an_engine():
    """What a document promises of an engine has two texts, and a number of a scene: its quote and where that stands."""
    values = {f"{name}.{node.name}" for name, node in classes() if is_a_method(node)}

    assert values == {"crosscheck.engines.methods.Method", "crosscheck.judge.delivery.Documented"}


def test_a_class_is_written_as_one():
    """Not made by a call, of words that no test here reads."""
    makers = {"namedtuple", "make_dataclass", "NamedTuple", "TypedDict", "new_class", "type", *ENUMERATIONS}
    calls = [(m, x) for m, path in modules().items() for x in ast.walk(tree(path)) if isinstance(x, ast.Call)]

    assert [(m, ast.unparse(x)) for m, x in calls if len(x.args) > 1 and makers & {*own_names(x.func)}] == []


def is_a_method(node):
    """Whether a class is called like a method, derived from it, or holds who and how (two texts) and what is called."""
    functions = {x.name: x for x in node.body if isinstance(x, ast.FunctionDef)}
    made = functions["__init__"].args if "__init__" in functions else ast.arguments(args=[], kwonlyargs=[])
    annotated = [(x.target.id, x.annotation) for x in node.body if isinstance(x, ast.AnnAssign)]
    fields = dict(annotated + [(x.arg, x.annotation) for x in (*made.args, *made.kwonlyargs) if x.annotation])
    texts = [key for key, kind in fields.items() if getattr(kind, "id", "") == "str"]
    taken = {x.arg for f in functions.values() for x in f.args.args} & {"scene", "scenes", "workload"}
    asked = {"solve", "run", "build", "measure", "answer", "__call__"} & {*functions}
    called = asked or any("Callable" in named(kind) for kind in fields.values())
    derived = any("Method" in named(base) for base in node.bases)
    alike = (len(texts) > 1 and (called or taken)) or (called and {"engine", "setting"} & {*dict(annotated)})
    return node.name.endswith(("Method", "Knob", "Bench")) or derived or bool(alike)


def past_the_registry(path):
    """Yield where a file asks an engine for its routes, or by one of them: `Method` does both."""
    for node in ast.walk(tree(path)):
        match node:
            case ast.Call(func=ast.Attribute(attr="routes" | "discovery" | "features" | "dynamic_routes")):
                yield node.lineno
            case ast.Call(func=ast.Name(id="terms_of"), args=[_, _, _]):
                yield node.lineno
            case ast.Call(func=ast.Attribute(value=who, attr="solve")):
                other = ast.unparse(who) in ("n", "self", "np.linalg", "run")  # a ledger's equations; a method's models
                if not other and (len(node.args) > 1 or "route" in {k.arg for k in node.keywords}):
                    yield node.lineno


def test_outside_of_the_engines_nobody_asks_one_but_by_its_methods():
    others = set(sources("crosscheck")) - set(sources("crosscheck/engines"))

    assert {path: list(past_the_registry(path)) for path in others if any(past_the_registry(path))} == {}


def test_a_class_name_is_used_once():
    """One name, one thing: also where the two would stand far apart."""
    names = [node.name for _, node in classes()]

    assert len(names) == len(set(names))


ENUMERATIONS = {"Enum", "StrEnum", "IntEnum", "ReprEnum", "Flag", "IntFlag", "EnumType", "EnumMeta"}


def enumerations():
    """Yield (module, class) for every enumeration, those derived from one of ours included."""
    bases = {node.name: set().union(*map(named, (*node.bases, *node.keywords))) for _, node in classes()}
    known = {*ENUMERATIONS}
    while own := {name for name, of in bases.items() if of & known} - known:
        known |= own
    yield from ((module, node) for module, node in classes() if node.name in known)


def members(node):
    """Yield (place in its class, names) for every member of an enumeration."""
    for k, x in enumerate(node.body):
        if isinstance(x, ast.Assign | ast.AnnAssign | ast.For | ast.If | ast.With | ast.Try):
            yield k, [y.id for y in ast.walk(x) if is_stored(y)]


def is_said(node, k, names):
    """Return whether a member's meaning stands below it, in its class by its name, or in a value of a few words."""
    member, *after = node.body[k : k + 2]
    below = bool(after) and isinstance(after[0], ast.Expr) and isinstance(after[0].value, ast.Constant)
    value = getattr(member, "value", None)
    in_words = isinstance(value, ast.Constant) and len(str(value.value).split()) > 2
    return (len(names) == 1 and (below or in_words)) or {*names} <= {*(ast.get_docstring(node) or "").split()}


def test_every_member_of_an_enumeration_says_what_it_means():
    every = [(f"{m}.{n.name}: {names}", n, k, names) for m, n in enumerations() for k, names in members(n)]

    assert len(every) > 100
    assert [where for where, *member in every if not is_said(*member)] == []
    of_enum = [x for path in modules().values() for x in ast.walk(tree(path)) if isinstance(x, ast.alias)]
    assert not [x.name for x in of_enum if x.name in ENUMERATIONS and x.asname]  # under its own name


def of_three_or_more():
    """Yield (module, function) for the public functions of a module's own with three arguments or more."""
    for module, path in modules().items():
        for node in tree(path).body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and len(arguments(node)) > 2:
                yield module, node


def arguments(node):
    """Return the names of a function's arguments; Hypothesis hands over the one with which a composite draws."""
    a = node.args
    starred = [f"{stars}{x.arg}" for stars, x in (("*", a.vararg), ("**", a.kwarg)) if x]
    plain = [x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs)]
    composite = any("composite" in named(x) for x in node.decorator_list)
    return {*plain[composite:], *starred}


def parameters(node):
    """Return the names in the Parameters section of a function; None if it has none."""
    section = re.search(r"^Parameters\n-+\n(.*?)(\n\n|\Z)", ast.get_docstring(node) or "", re.DOTALL | re.MULTILINE)
    heads = re.findall(r"^(\S.*?)(?: : .*)?$", section[1], re.MULTILINE) if section else ()
    return {name for head in heads for name in head.split(", ")} if section else None


def test_arguments_are_said_in_parameters_sections_that_cannot_go_stale():
    """A command leaves out what every command has: its help is made of the section."""
    sections = [(m, n.name, parameters(n), arguments(n)) for m, n in of_three_or_more()]
    missing = [f"{m}.{n}" for m, n, said, all_ in sections if said != all_ and not (said and ".commands." in m)]

    assert [f"{m}.{n}: {said - all_}" for m, n, said, all_ in sections if said and said - all_] == []
    assert missing == []


def written_out(*values):
    """Return the modules that write out just these texts, in any order: a sequence, a set, members, or one text."""
    places = []
    for module, path in modules().items():
        for node in ast.walk(tree(path)):
            members = (
                [x.value for x in getattr(node, "body", ()) if isinstance(x, ast.Assign)] if is_class(node) else ()
            )
            texts = {getattr(x, "value", None) for x in (*getattr(node, "elts", ()), *members)}
            text = getattr(node, "value", None)
            words = re.split(r"[\s,;|/]+", text) if isinstance(text, str) else ()
            if set(values) in (texts, set(words)):
                places.append(module)
    return places


def is_class(node):
    return isinstance(node, ast.ClassDef)


def test_quantities_and_default_engines_are_written_out_once():
    assert written_out("position", "velocity", "acceleration") == ["refkin.motion"]
    assert written_out("exudyn", "pinocchio", "mujoco") == ["crosscheck.scenes.names"]


def assigned(name):
    """Return the modules that give a name a value, in whatever way and wherever; a text is a member's, no number."""
    kinds = ast.Assign | ast.AnnAssign | ast.AugAssign | ast.NamedExpr
    nodes = [(module, x) for module, path in modules().items() for x in ast.walk(tree(path)) if isinstance(x, kinds)]
    numbers = [(module, x) for module, x in nodes if not isinstance(getattr(x.value, "value", None), str)]
    return {module for module, x in numbers if name in {y.id for y in ast.walk(x) if is_stored(y)}}


def is_stored(node):
    return isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)


def test_a_regular_pose_is_told_from_a_singular_one_by_one_threshold():
    """It stands where an answer's statuses are said: the plain analysis, the proof and the peers have it from there."""
    assert assigned("SINGULAR") == {"refkin.motion"}


def test_the_round_off_rule_has_one_definition():
    assert assigned("ROUND_OFF") == {"refkin.newton"}


FROM_THE_TRUTH = {"crosscheck.judge.truth", "crosscheck.judge.prices"}
FROM_THE_TRUTH |= {"crosscheck.measure.price_process", "crosscheck.measure.price", "crosscheck.report.prices"}
FROM_THE_TRUTH |= {"crosscheck.commands.price", "crosscheck.problems.export", "crosscheck.commands.documents"}


def defined():
    """Yield (module, name) of every function and class."""
    for module, path in modules().items():
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                yield module, node.name


def test_attainable_is_one_thing_half_an_ulp_of_what_is_given():
    """One function says what it is, and who says the word has it from there."""
    texts = {module: path.read_text(encoding="utf-8") for module, path in modules().items()}

    assert [(module, name) for module, name in defined() if "attainable" in name.lower()] == [
        ("crosscheck.judge.truth", "attainable_levels")
    ]
    assert {module for module, text in texts.items() if "attainable" in text.lower()} == FROM_THE_TRUTH


@pytest.mark.parametrize("path", sources("crosscheck"), ids=lambda p: str(p.relative_to(ROOT)))
def test_child_processes_begin_in_one_place(path):
    attributes = {node.attr for node in ast.walk(tree(path)) if isinstance(node, ast.Attribute)}
    names = {name.split(".")[0] for name in imported(path)} | attributes
    ways = {x for x in names if re.match("multiprocessing|concurrent|.*subprocess|joblib|fork|posix_spawn|popen", x)}

    assert not ways or path.parent.name == "workers" or path.name == "c_kernels.py"  # which calls a compiler


SHARED = 6


def passages(paths):
    """Return the runs of so many lines of some files, without imports, comments, and what is empty."""
    seen = set()
    for path in paths:
        text = re.sub(r"^ *#.*", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
        nodes = [node for node in ast.walk(tree(path)) if isinstance(node, ast.Import | ast.ImportFrom)]
        of_imports = {k for node in nodes for k in range(node.lineno, node.end_lineno + 1)}
        said = [line.strip() for k, line in enumerate(text.splitlines(), 1) if k not in of_imports and line.strip()]
        seen |= {tuple(said[k : k + SHARED]) for k in range(len(said) - SHARED + 1)}
    return seen


def test_tests_and_source_share_no_six_lines():
    of_source = passages([*sources("refkin"), *sources("crosscheck")])

    assert passages(sources("tests")) & of_source == set()
