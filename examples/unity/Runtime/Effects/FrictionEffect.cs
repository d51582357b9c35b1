using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Dry friction: a bristle that holds the hand, and gives way when pulled too hard.</summary>
    [AddComponentMenu("Tensionlab/Friction")]
    public class FrictionEffect : HapticEffect
    {
        [Min(0f), Tooltip("Force F_n that presses, in N, where nothing else does.")]
        public float load = 1f;
        [Min(0f), Tooltip("Friction coefficient mu_s while it sticks.")]
        public float sticking = 0.5f;
        [Min(0f), Tooltip("Friction coefficient mu_d while it slides.")]
        public float sliding = 0.35f;
        [Min(0f), Tooltip("Stiffness s0 of the bristle, in N/m.")]
        public float stiffness = 400f;
        [Min(0f), Tooltip("Damping s1 of the bristle, in N s/m.")]
        public float damping = 2f;

        protected override string Kind { get { return "friction"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            parameters["load"] = load;
            parameters["static"] = sticking;
            parameters["dynamic"] = sliding;
            parameters["stiffness"] = stiffness;
            parameters["damping"] = damping;
        }
    }
}
