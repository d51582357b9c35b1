using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>Viscous damping. Continuous; passive.</summary>
    [AddComponentMenu("Tensionlab/Viscous")]
    public class ViscousEffect : HapticEffect
    {
        [Min(0f), Tooltip("Damping b, in N s/m.")]
        public float damping = 2f;

        protected override string Kind { get { return "viscous"; } }

        protected override void Describe(Dictionary<string, object> parameters, RigFrame rig)
        {
            parameters["damping"] = damping;
        }
    }
}
