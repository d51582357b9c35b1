using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Flat wall: a spring and a damper that only push, along the object's y.</summary>
    [AddComponentMenu("Tensionlab/Wall")]
    public class WallEffect : HapticEffect
    {
        [Min(0f), Tooltip("Stiffness K of the spring, in N/m.")]
        public float stiffness = 300f;
        [Min(0f), Tooltip("Damping B on the way in, in N s/m.")]
        public float damping = 2f;

        protected override string Kind { get { return "wall"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            parameters["plane"] = Plane(rig);
            parameters["stiffness"] = stiffness;
            parameters["damping"] = damping;
        }
    }
}
