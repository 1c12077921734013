"""What a mutant changes: cosmic-ray's operators that change a formula, and two of our own.

Of cosmic-ray's replacements of one operator by any other, those stay that a person might write by mistake: a wrong
sign, a quotient for a product, `<` for `<=`. A sum turned into a shift of bits fails at once and tells nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

from cosmic_ray.operators.operator import Example, Operator
from cosmic_ray.plugins import get_operator
from parso.python.tree import Name
from parso.python.tree import Operator as Token

BINARY = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul", "FloorDiv_Mul", "Mod_FloorDiv", "BitAnd_BitOr")
COMPARISON = ("Lt_LtE", "Lt_GtE", "LtE_Lt", "LtE_Gt", "Gt_GtE", "Gt_LtE", "GtE_Gt", "GtE_Lt", "Eq_NotEq", "NotEq_Eq")
IDENTITY = ("Is_IsNot", "IsNot_Is")
UNARY = ("Delete_USub", "Delete_Not", "Delete_Invert")
OTHERS = (
    "AddNot",
    "NumberReplacer",
    "ReplaceAndWithOr",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "ReplaceFalseWithTrue",
    "ReplaceOrWithAnd",
    "ReplaceTrueWithFalse",
    "ZeroIterationForLoop",
)

TOKENS = {"+=": "-=", "-=": "+=", "*=": "/=", "/=": "*=", "&=": "|=", "|=": "&=", "@": "*", "|": "&"}
FUNCTIONS = {
    "all": "any",
    "any": "all",
    "argmax": "argmin",
    "argmin": "argmax",
    "ceil": "floor",
    "cos": "sin",
    "cosh": "sinh",
    "exp": "expm1",
    "floor": "ceil",
    "max": "min",
    "maximum": "minimum",
    "min": "max",
    "minimum": "maximum",
    "nanmax": "nanmin",
    "nanmin": "nanmax",
    "sin": "cos",
    "sqrt": "cbrt",
}
METHODS = {"mean": "sum", "sum": "mean"}  # the built-in sum has no such counterpart


class ReplaceToken(Operator):
    """Replaces the operators that cosmic-ray leaves alone: augmented assignments, products of matrices."""

    def mutation_positions(self, node) -> Iterator[tuple]:
        if isinstance(node, Token) and node.value in TOKENS and node.parent.type != "decorator":
            yield node.start_pos, node.end_pos

    def mutate(self, node, index: int):
        node.value = TOKENS[node.value]
        return node

    @classmethod
    def examples(cls) -> tuple[Example, ...]:
        return Example("x += y", "x -= y"), Example("x = y @ z", "x = y * z")


class ReplaceFunction(Operator):
    """Replaces a function that is called by its counterpart: a minimum by a maximum, a sine by a cosine."""

    def mutation_positions(self, node) -> Iterator[tuple]:
        if isinstance(node, Name) and node.get_next_leaf() == "(":
            is_method = node.get_previous_leaf() == "."
            if node.value in FUNCTIONS or (is_method and node.value in METHODS):
                yield node.start_pos, node.end_pos

    def mutate(self, node, index: int):
        node.value = {**FUNCTIONS, **METHODS}[node.value]
        return node

    @classmethod
    def examples(cls) -> tuple[Example, ...]:
        return Example("x = np.sin(y)", "x = np.cos(y)"), Example("x = y.min()", "x = y.max()")


def operators() -> dict[str, Operator]:
    """All operators by name."""
    names = [
        *(f"ReplaceBinaryOperator_{name}" for name in BINARY),
        *(f"ReplaceComparisonOperator_{name}" for name in (*COMPARISON, *IDENTITY)),
        *(f"ReplaceUnaryOperator_{name}" for name in UNARY),
        *OTHERS,
    ]
    chosen = {name: get_operator(f"core/{name}")() for name in names}
    return {**chosen, "ReplaceToken": ReplaceToken(), "ReplaceFunction": ReplaceFunction()}
