"""Hashes of the MUKCa recordings: by robot, each placement of the block and its two sockets.

Placements are in alphabetical order, which numbers the sockets: `2 * placement + hole`.
"""

Placement = tuple[str, str, str]

#: By robot: name of the placement, SHA-256 of `hole_0.csv`, SHA-256 of `hole_1.csv`.
PLACEMENTS: dict[str, tuple[Placement, ...]] = {
    "panda_1": (
        (
            "back-high",
            "fce2785bbb5c921285dae197a7348c9cb8cd2cbd2562cf192107958f6475eb25",
            "0167d20da3bdc10946991ce64caeaf223463e3adba03cf7ed81bc2b2c713c844",
        ),
        (
            "front",
            "8150ed4a6d027fe245ae8f444cd01a6064626208d298380520f57a8fd3580d00",
            "4c268a8a54bbe2f62c08017b090ce84c5cb5c348700deb81b884d2911c56cb6e",
        ),
        (
            "right",
            "4b3920f88a1e759c3069015015f34d4ff9ae79213549998dce0a41d3b9271df3",
            "d59894defa190a02c757e89eee0f4aba3d56ce5918744d041e2545e101f69aa1",
        ),
    ),
    "panda_3": (
        (
            "backcenter",
            "be47cb91a497f4e13b443e68d74db9f6dc799ca1321c506b1b971cd987039841",
            "85c936cfc57d1af91239f7bc5e294993f01ea2e170168f28521e17940f54e699",
        ),
        (
            "backleft",
            "afb1d1b4d279e0cf6995996abe5833e02e61a3f92621cb38bdbc477ac49b111f",
            "84ba3cc75acae01c23f53bd965d0e048bc04d58f2271c4afd1de3118b95e2e2a",
        ),
        (
            "backright",
            "2f663c9a8523234f4011bb06ca123e1ff0e50a1478e2fcc876f40943005cdb70",
            "933268a33c8f8dbe45e7755d32fbdb0dc9276ffa1a7d3c67e3e0a26f67b1111b",
        ),
        (
            "frontcenter",
            "ca2a7d595fb90a6e9e112b7b78bc849b32691a1f764fe9623e762f060af5ceab",
            "cc7a53830159e4f7f058d04bfb33b64aa758f522757b01f3f6a09c57727033eb",
        ),
        (
            "frontleft",
            "2ff9f7f9cb03c76ba13735f6ba5083126c7dfd332cdf447f883e1f930b8a7a3c",
            "d7b9e45c036de5f6d574bb8f439ce1e24894adb88e9d41e3a948ab278e7cd49d",
        ),
        (
            "frontright",
            "4238c42b5bf33514241e3b7bb21e18cb3c9b01b8e35ef857898b1660e5ee349e",
            "c8e6f3586d2b10b53373c473d59c5de818794f8a8fab579b37231a9703e5caae",
        ),
    ),
    "kuka_14": (
        (
            "front",
            "6a23482ad523f21d63b692c411d17b046c86a184b453941eaaac49ccf638691f",
            "6c223d26c61b79813465d9411f62442506c8bf51d49cefd3e27538c920ec9262",
        ),
        (
            "left_back",
            "95aa5241598b6320a9afaf07a7798bf144f0f9725233104e4bdb30afde6549b3",
            "2c7683a3c02b36307c9dbd4285fec4f7f023474fbdebde3028ac19405b25dd94",
        ),
        (
            "raised_left",
            "f28eaae6e23dd036bdbbacc7890e9ff43d3bdfe42a10029f008394adb8de3c71",
            "271509707e1292ab672d35a9254f344e92a122a4dce294012bde219253dbd007",
        ),
    ),
    "dinova_1": (
        (
            "front",
            "63a31de7d5d55bca015dd508df6785e840bc61dd5f7654c24128bdf766c33f10",
            "a4a7532b4e14cfed0d4b3c391f1ebccd23ecc9467082bfb4b6afe188743536ec",
        ),
        (
            "left",
            "68eeb7d127a1cf4b62e1ddf86813741dd477756bbd2989836e520693792d92bc",
            "ca55345d2c79890a4323cbbeca409f87f9647acb402e8b9256c732ae9f2bc15a",
        ),
        (
            "lower_left",
            "8207650e5de0561b40a5a11b249caf2274c9ab50ad81df82f278e511fb4fa0ba",
            "5229e66c11f11c54cb50efa74115ca11c479819328d135b262b4b46ae1f222ac",
        ),
        (
            "raised_back",
            "cdab7978fdee6b8d978130536b6df3671769454ce5db24b1f770cf5fe9256c26",
            "37e52a60cefb1f422bf65dfcfbe218146e7d3cd199672b2fcad0105a850f19a3",
        ),
    ),
}
