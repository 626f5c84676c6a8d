"""Which of our categories a catalogue's model belongs to, and the words for it: a table, no guessing.

A name counts in the catalogue's groups of indoor things only (a bench in the street is no bench for a
hall), unless the table names another group. Names that mean several things, such as "Lamp", are decided
model by model. What stands in neither table has no category, and ``Catalogue.report`` names it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

OUTDOOR_GROUPS = frozenset({"Exterior", "Vehicles", "Characters", "Staircases"})
"""Groups of the catalogues whose models stand in homes only where the table says so."""


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What a model is called."""

    category: str
    """Of ``taxonomy.CATEGORIES``."""
    phrase: str
    """The noun a person would use, without article."""


_NAMES: Mapping[str, str] = {
    # seats and beds
    "chair": """
        Living room/Chair; Chair with cushion = chair; Child chair; Children chair = child chair;
        Folding chair; Oak chair; Osaka chair = chair; Plastic chair; Ryokan chair = floor chair;
        Exterior/Cafe chair = cafe chair; Exterior/Teck chair = teak chair
    """,
    "armchair": """
        Living room/Armchair; Modern armchair; Winchester armchair = leather armchair;
        Exterior/Rattan armchair = rattan armchair
    """,
    "sofa": """
        Burlap sofa; Clear sofa = sofa; Convertible sofa BZ = sofa bed; Corner sofa; Couch; Futon couch; Sofa;
        Sofa 2 seats = two-seat sofa; Sofa 3 seats = three-seat sofa; Winchester sofa = leather sofa;
        Exterior/Rattan sofa = rattan sofa
    """,
    "stool": "Bar chair; Bar stool; Stool",
    "bench": "Bench; Piano bench",
    "office chair": "Office/Chair = office chair",
    "pouf": "Puff = pouf",
    "bed": """
        Bed; Bunk bed; Captain's bed; Child bed = child's bed; Day bed; Hospital bed; Iron bed;
        Opened convertible sofa BZ = sofa bed
    """,
    # tables
    "dining table": """
        Black table; Glass table; Oak table = round table; Round table; Folding table; Table on trestles;
        Table with tablecloth = table; Wooden alder table = wooden table; Office/Wooden table = wooden table;
        Wooden teak table = wooden table
    """,
    "coffee table": "Coffee table; Exterior/Rattan table = rattan table",
    "desk": "Desk; Desk table = desk; Wooden desk",
    # storage
    "nightstand": "Bedside table = nightstand",
    "bookshelf": """
        Bookcase; Full bookcase = bookcase; Bedroom/Shelves = bookshelf; Vertical shelves = bookshelf
    """,
    "wardrobe": "Wardrobe; Cupboard",
    "dresser": "Dresser with drawers = dresser",
    "tv stand": "TV stand = tv stand",
    "chest": "Bedroom/Chest; Trunck = trunk",
    # kitchen
    "kitchen cabinet": """
        Drawers cabinet = kitchen cabinet; Lower cabinet = kitchen cabinet;
        Small lower cabinet = kitchen cabinet; Lower corner cabinet = corner cabinet
    """,
    "wall cabinet": """
        Glass door cabinet; Upper cabinet = wall cabinet; Small upper cabinet = wall cabinet;
        Upper corner cabinet = corner cabinet; Upper shelves cabinet = wall cabinet
    """,
    "kitchen sink": "Kitchen/Sink = kitchen sink; Sink cabinet = kitchen sink",
    "stove": "Large stove = stove",
    "fridge": "Fridge; Large fridge = fridge; Refrigerator = fridge",
    "range hood": "Hood = range hood; Range hood",
    "microwave": "Microwave",
    "trash can": "Bullet trash can = trash can; Dustbin = trash can; Recycling bin",
    # bathroom
    "toilet": "Toilets unit = toilet",
    "washbasin": """
        Double vanity = double washbasin; Small lavatory = washbasin; Vanity = washbasin; Washbasin
    """,
    "bathtub": "Bath = bathtub; Corner bathtub = bathtub; Island bath = bathtub",
    "shower": "Shower stall = shower",
    "washing machine": "Clothes washing machine = washing machine; Washing machine",
    "laundry basket": "Clothes basket = laundry basket",
    "towel rail": "Towel rack = towel rail",
    # devices and light
    "tv": "TV; TV 16:9 = tv; Wall flat TV = flat tv",
    "table lamp": "Desk lamp; Little lamp = table lamp",
    "ceiling lamp": "Ceiling lamp; Chandelier lamp = chandelier; Hanging light = pendant lamp; Pendant lamp",
    # on walls and floors
    "curtain": "Curtain",
    "radiator": "Radiator",
    "rug": "Bathmat = bath mat; Doormat; Oriental rug; Round carpet = round rug",
    "potted plant": """
        Living room/Bamboo; Bonsai tree = bonsai; Cactus; Decorative plant = plant; Living room/Ficus;
        Flowers; Indoor plant = plant; Little plant = small plant; Orchids; Plant; Spathiphyllum = plant;
        Spider plant; Succulent plant; Tulips; White lily = lily; Yucca
    """,
    "piano": "Grand piano; Upright piano",
    # openings
    "window": """
        Double French window 3 panes = window; Double French window small panes = window;
        Double arched window = arched window; Double window 3 panes = window; Double window 4 panes = window;
        Double window with large pane = window; Double-hung window = window; Quadruple French window = window;
        Quadruple French window 3 panes = window; Quadruple French window small panes = window;
        Quadruple arched window = arched window; Sliding window; Triple French window = window
    """,
    "door": """
        Door; Double door; Double door with panes = double door; Exterior door = front door; Glass door;
        Screen door
    """,
    # things that physics lays down
    "cup": "Coffee cup; Coffee mug; Cup; Plastic cup",
    "bowl": "Bowl; Bowl with fruits = bowl of fruit; Bowl with salad = bowl of salad",
    "bottle": """
        Baby bottle; Beer bottle; Bottle; Medicine bottle; Wine bottle; Yogurt bottle
    """,
    "book": "Book",
    "vase": "Vase",
    "cooking pot": "Large pan = cooking pot",
    "ball": "Basketball; Soccer ball",
    "cardboard box": "Cardboard box; Open cardboard box = cardboard box",
    "toy car": "Car model = toy car",
    "shoe": "Bootie = boots; Mocassin = moccasins; Slippers; Sneakers; Woman shoes = shoes",
}
"""Names for each category, each with the group it must stand in, if any, and its words, if they differ."""

_MODELS: Mapping[str, str] = {
    "Blend Swap CC-0#ammoBox": "chest = wooden chest",
    "Blend Swap CC-0#armchair": "chair",
    "Blend Swap CC-0#lamp2": "ceiling lamp = chandelier",
    "Blend Swap CC-0#shelves": "bookshelf = shelf",
    "Blend Swap CC-0#table": "dining table = table",
    "Blend Swap CC-BY#armChair2": "armchair = lounge chair",
    "Blend Swap CC-BY#cafe_set_tonon_table": "side table",
    "Blend Swap CC-BY#lamp": "table lamp",
    "Blend Swap CC-BY#table": "dining table = table",
    "Kator Legaz#pedestal-vase-lamp": "table lamp",
    "Kator Legaz#utility-shelving": "storage shelf",
    "Scopia#chair-ottoman": "armchair = lounge chair",
    "Scopia#clothes-rack": "coat rack = clothes rack",
    "Scopia#living_lamp": "floor lamp",
    "Scopia#living_room_table": "coffee table",
    "Scopia#livingroom_lamp1": "table lamp",
    "Scopia#table-with-leaning-feet": "dining table = wooden table",
    "Scopia#table4": "dining table = wooden table",
    "Scopia#table_lamp": "table lamp",
    "Scopia#white_kitchen_table": "dining table = table",
    "Scopia#wooden_table_office": "dining table = wooden table",
}
"""Decided by looking at the model; these win over the names."""


def _table(text: Mapping[str, str]) -> Mapping[tuple[str | None, str], Kind]:
    """(group, name) of each entry, the group None where any indoor one will do."""
    table = {}
    for words, entries in text.items():
        for entry in entries.split(";"):
            place, _, phrase = (part.strip() for part in entry.partition("="))
            group, _, name = place.rpartition("/")
            key = (group or None, name)
            assert key not in table, key
            table[key] = Kind(category=words.replace(" ", "_"), phrase=phrase or name.lower())
    return MappingProxyType(table)


def _models(text: Mapping[str, str]) -> Mapping[str, Kind]:
    table = {}
    for model, entry in text.items():
        words, _, phrase = (part.strip() for part in entry.partition("="))
        table[model] = Kind(category=words.replace(" ", "_"), phrase=phrase or words)
    return MappingProxyType(table)


KINDS_BY_NAME = _table(_NAMES)
KINDS_BY_MODEL = _models(_MODELS)


def kind_of(model: str, group: str, name: str) -> Kind | None:
    """What a model is, or None where the tables do not say.

    Args:
        model: Its id, such as ``Scopia#bed1``.
        group: The catalogue's category, such as ``Living room``.
        name: The catalogue's name, such as ``Burlap sofa``.
    """
    if model in KINDS_BY_MODEL:
        return KINDS_BY_MODEL[model]
    if (group, name) in KINDS_BY_NAME:
        return KINDS_BY_NAME[group, name]
    return None if group in OUTDOOR_GROUPS else KINDS_BY_NAME.get((None, name))
